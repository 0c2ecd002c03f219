"""The next experiments of a campaign: offered, chosen, handed over, taken in again, and when to stop."""
