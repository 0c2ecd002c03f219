"""What was taken for constant and is not: which number, in which recordings, with what it goes."""
