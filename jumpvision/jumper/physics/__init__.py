"""The jumper simulated: a model of mechanisms, what drives it, and its motion on hard ground and on sand."""
