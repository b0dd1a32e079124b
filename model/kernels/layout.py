"""Order of the numbers that kernels read: parameter vector ``p`` and integer tables of a scene.

The scene packs both; a kernel finds a value by the constants below. Integers describe structure (which
body, which shape), floats describe values, so that a changed value never compiles or reorders anything.
Every coordinate is the angle of one body's revolute joint, or the height (m) of a vertical guide without mass that
carries a body; body index = coordinate index; a parent has no parent of its own (two levels: enough for action, motor
arm, flexible shank, a key that lifts).
"""

from typing import NamedTuple

import numpy as np

# parents that are no body: a joint fixed to the ground, and the ground under a vertical guide
GROUND, GUIDED = -1, -2

# shapes of the second surface of a contact
CIRCLE, LINE, HYBRID = 0, 1, 2

# drives: what the scalar input u(t) does
FORCE_DOWN, JOINT_TORQUE, AMPLIFIER = 0, 1, 2

# p[0:3]
GRAVITY, V_T, OMEGA_T = 0, 1, 2
GLOBALS = 3

# per body
PIVOT_X, PIVOT_Y, COM_X, COM_Y, MASS, INERTIA, JF_A, JF_B1, JF_B2 = range(9)
BODY_SIZE = 9

# per spring: torque on the joint = T0 - k (q - q0)
SPRING_T0, SPRING_K, SPRING_Q0 = range(3)
SPRING_SIZE = 3

# per contact; N_X, NY is a line's normal or the start direction of a hybrid's arc, E_X, E_Y the arc's end
A_X, A_Y, A_R, B_X, B_Y, B_R, N_X, N_Y, E_X, E_Y, K_A, K_B, K_C, DAMP, MU_A, MU_B1, MU_B2 = range(17)
# then, per coordinate of the chain, the most the gap can change when it turns by 1 rad, m (derived by the scene)
REACH = 17
CONTACT_SIZE = REACH + 4

# per drive: point of a force in the body's frame
DRIVE_X, DRIVE_Y = 0, 1
DRIVE_SIZE = 2
# an amplifier acts on a winding; its coordinate is the charge that has passed (its speed is the current, its inertia
# the inductance), the motor that it turns is the one before. Alone in its scene. Ohm, N m/A, then as `drives.amplifier`
WINDING_R, WINDING_K, WINDING_AMPLIFIER = 0, 1, 2
WINDING_SIZE = 7

# per probe (one-sided vertical contact between a point of body A and a point of body B)
PROBE_SIZE = 8  # A x, A y, B x, B y, a, b, c, D

# per damper: torque on the joint = -d v
DAMPER_SIZE = 1

# per direction in which a joint gives: force on the body = load - k d - c dd/dt
PIN_K, PIN_C, PIN_LOAD = range(3)
PIN_SIZE = 3

# a string in place of the bar: in p how many modes it has and what those left out give way (m/N), then rows of their
# gains (1/kg), stiffnesses (1/s^2), dampings (1/s); its states: the time at which free modes were left, or
# `elements.strings.AWAKE` while they are stepped, energy (J) lost meanwhile, then ways (m) and rates (m/s)
STRING_GIVE, STRING_HEAD = 1, 2
SINCE, RELEASED, STRING_STATES = 0, 1, 2

MAX_CHAIN = 4

# counters written by the kernels
N_STEPS, N_REJECTED, N_RHS, N_JACOBIAN, N_CONTACT, N_SKIPPED, N_RESTS = range(7)
COUNTERS = (
    "n_steps",
    "n_rejected",
    "n_rhs",
    "n_jacobian",
    "n_contact_evaluations",
    "n_contacts_skipped",
    "n_rests",
)


class Tables(NamedTuple):
    """Structure of a scene, int64 arrays (n = coordinates, c = contacts, s = springs, d = drives, b = probes)."""

    parent: np.ndarray  # (n,) index of the parent body, GROUND, or GUIDED for a vertical guide
    spring: np.ndarray  # (s,) body of each spring
    contact: np.ndarray  # (c, 6) body A, B (-1 ground), shape of B, length of the chain, law of felt, how many numbers
    chain: np.ndarray  # (c, MAX_CHAIN) coordinates that move A against B
    drive: np.ndarray  # (d, 2) kind, body
    probe: np.ndarray  # (b, 2) body A, body B; both hang from ground
    offset: (
        np.ndarray
    )  # (9,) where springs, contacts, drives, probes, motion, dampers, laws of felt, string, pins start in p
    prescribed: np.ndarray  # (n,) 1 where a coordinate follows the motion in p; such come last and carry no other body
    damper: np.ndarray  # (k,) body of each damper
    rail: np.ndarray  # (0,) or (1,) contact on which a guided body rests
    string: np.ndarray  # (0,) or (1,) contact in which a string stands for the bar
    memory: np.ndarray  # (z,) contact of each state of felt that remembers; those of one contact together
    pin: np.ndarray  # (g, 2) body whose joint gives, and in which direction of the world: 0 right, 1 up
