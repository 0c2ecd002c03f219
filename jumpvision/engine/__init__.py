"""Questions any simulator: learns the noise, fits, detects a misfit, names its cause, says what naming it is worth.

Whatever can predict a motion is a `system.System`: a pendulum, a ball or the jumper of this package. It imports
`estimate` and `base` only, and knows no robot.
"""
