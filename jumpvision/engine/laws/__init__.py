"""Laws as text: one tree, and from it values, machine code, JavaScript, mathtext, derivatives, dimensions."""
