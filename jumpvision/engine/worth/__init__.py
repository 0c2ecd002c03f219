"""What is found is worth: on motions held out, and what experiment would tell more."""
