"""Films to numbers: frames are read, balls, feet, beds and grains are found in them, fields become momentum and a cone.

Arrays in, arrays out: nothing here reads a folder, prints or draws. `frames` opens films, `vision` works in pixels
and frames, `grains` in SI units, y up.
"""
