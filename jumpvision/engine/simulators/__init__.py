"""Simulators that people have, as the function of a Study: a MuJoCo model, an FMU, any program.

Each names places of the model and what stands there: a parameter of the study, else an input of the recording.
"""
