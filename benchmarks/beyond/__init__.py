"""Laws that no vocabulary holds: worlds that hide them, peers that look for them, and the score."""
