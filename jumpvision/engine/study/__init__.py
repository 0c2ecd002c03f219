"""Any simulator in question: what a user hands over, its runs, and the system that they make."""
