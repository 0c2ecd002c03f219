"""The robot of the thesis: mechanisms (laws of force), its equations of motion, plans for its motor, its questioning.

`mechanisms` holds the laws, `physics` solves the motion, `planning` finds commands, `question` makes jumps a system
for `jumpvision.engine`.
"""
