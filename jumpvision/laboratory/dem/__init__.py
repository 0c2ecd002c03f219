"""A small discrete-element simulation of discs under a foot."""
