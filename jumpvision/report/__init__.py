"""Pages, figures and films of what was found."""
