"""Columns of the observables of a contact, a tip, a body with its joint (`evaluate_observables`)."""

NORMAL, FRICTION, DEPTH, SLIDE, RUBBED, FELT, NX, NY, X, Y, RATE = range(11)
"""Columns of a contact: normal and friction force; depth, negative where open; sliding speed of A over B along
t = z x n, 0 where open; powers lost by rubbing and in the felt; normal and point of action; rate of the depth."""
CONTACT = RATE + 1
TIP_FORCE, TIP_LOST, TIP_DEPTH = range(3)
TIP = TIP_DEPTH + 1
PIVOT_X, PIVOT_Y, ANGLE, CENTRE_X, CENTRE_Y, TURNING, TURNED, VX, VY, AX, AY = range(11)
JOINT_X, JOINT_Y, BRAKED, RATED, HELD = range(11, 16)
"""Columns of a body: pivot, angle and centre of mass; angular speed and acceleration from ground; velocity and
acceleration of the centre of mass; force on it in its joint; power lost there; acceleration of its coordinate; of the
body whose motion is prescribed, the input that holds it: force on the key, N down, or torque of arm or finger, N m."""
BODY = HELD + 1
