"""The ball on the rod in every frame of a film."""
