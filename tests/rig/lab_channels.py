"""A further voltage input as a lab writes it in its rig file: the wire from the motor's output, shifted and scaled."""

READBACK = """
[[channels]]
name = "motor_readback"
channel = "Dev1/ai1"
quantity = "what the motor is told, as read back"
unit = "N"
sensor = "wire from ao0"
calibration = "12 N per V, shifted by 3 N"
electrical = [0.0, 2.0]
physical = [3.0, 27.0]
least = -60.0
most = 60.0
"""
