"""The bench behind the terminals: plant, motor, sensors, operator, camera, wiring and clock.

In: the volts the motor's output is at, from edge to edge of the sample clock; a bench file with the true values.
Out: load cell output and encoder counts at those edges; films of the action; the truth, for tests.
"""
