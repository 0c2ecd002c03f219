"""Unknowns of the image of a disc, in their order in every array of them; what they mean is told in `disc`."""

NAMES = ("x", "y", "R", "s", "b", "a", "bx", "by", "gx", "gy", "wx", "wy")
X, Y, R, S, B, A, BX, BY, GX, GY, WX, WY = range(12)
