"""Layout of a step's workspace: one flat float64 array shared by the step loop and the generated kernels.

One array with offsets known at compile time lets the compiler see that nothing overlaps. Vectors are padded to
``WIDTH`` with zeros, so that loops over them have a fixed length.
"""

WIDTH = 8  # most coordinates a scene may have
MAX_STAGES = 8
MAX_CONTACTS = 60  # bits of the mask of skipped contacts

Q, V, Q1, V1, ACC, F_U, M_DIAG, M_UP = (WIDTH * k for k in range(8))
ALLOWANCE = 8 * WIDTH  # (WIDTH,) how far each coordinate may move before skipped contacts are evaluated again
STIFF = 9 * WIDTH  # (WIDTH, WIDTH) K = df/dq - (dM/dq) a
DAMP = STIFF + WIDTH * WIDTH  # (WIDTH, WIDTH) D = df/dv
LU = DAMP + WIDTH * WIDTH  # (WIDTH, WIDTH) inverse of the matrix of a step
ROOM = LU + WIDTH * WIDTH  # (MAX_CONTACTS,) distance the surfaces can approach before they may touch; 0 = touching
GAP = ROOM + MAX_CONTACTS  # (MAX_CONTACTS,) the room, or minus the penetration where surfaces touch, m
GAP_RATE = GAP + MAX_CONTACTS  # (MAX_CONTACTS,) its rate, m/s
GAP_ACC = GAP_RATE + MAX_CONTACTS  # (MAX_CONTACTS,) and the rate of that, m/s^2, joints' accelerations only
KICK = GAP_ACC + MAX_CONTACTS  # (MAX_CONTACTS,) jump of a joint's acceleration per m that felt is pressed in, 1/(m s^2)
SLIDE = KICK + MAX_CONTACTS  # (MAX_CONTACTS,) sliding speed of touching contacts with friction, m/s
SLIDE_RATE = SLIDE + MAX_CONTACTS  # (MAX_CONTACTS,) and its rate, m/s^2, joints' accelerations only
GRIP = SLIDE_RATE + MAX_CONTACTS  # (MAX_CONTACTS,) acceleration of a joint by full friction, rad/s^2
U = GRIP + MAX_CONTACTS  # (MAX_STAGES, 2, WIDTH) stages: angle part, speed part
AUDIT_Q = U + MAX_STAGES * 2 * WIDTH  # state at which energies and powers are asked for
AUDIT_V = AUDIT_Q + WIDTH
(
    ENERGY, POWER_IN, POWER_FELT, POWER_FRICTION, POWER_JOINTS, POWER_RAIL, POWER_SHANK, POWER_PINS, POWER_STRING,
    POWER_DRIVE,
) = range(AUDIT_V + WIDTH, AUDIT_V + WIDTH + 10)  # fmt: skip  # J, W; the last five only where a scene has the effect
STATIC = ENERGY + 2 * WIDTH  # 1 leaves (dM/dq) a out of K, for statics
PIECE = STATIC + 1  # piece of the prescribed motion found last
# limits of errors (rad, rad/s), the step wanted or fitted to events (s), error of the step, of the limits, and the
# fraction of it at which a state inside is asked for: into AUDIT_Q, AUDIT_V, AUDIT_Z
ANGLE_LIMIT, SPEED_LIMIT, FITTED, ERROR, FRACTION = range(STATIC + 2, STATIC + 7)
DENSE = STATIC + WIDTH  # (MOST_DENSE, 2, WIDTH) sums over the stages that a state inside the step is made of
MOST_DENSE = 4
SIZE = DENSE + MOST_DENSE * 2 * WIDTH
# where members advance side by side in lanes, each of these places is a row of lanes, and their kernels also read:
INPUT, INPUT_RATE, STAGE_STEP, STEP_RATE, IDLE, NEEDED = range(SIZE, SIZE + 6)
# input u; weight of du/dt; gamma h; 1/h; 1 in a lane without a member; contacts that the member itself needs
LANE_SIZE = SIZE + WIDTH
# where contacts remember (`layout.Tables.memory`), their states lie beyond all of these, in rows of their own:
MOST_FELT, LINKS = 40, 16  # three for each of thirteen contacts; coordinates that move a contact, pins among them
MOST_MODES = 100
MOST_PINS = 10  # two directions of five joints
MOST_MEMORIES = MOST_FELT + 2 * MOST_PINS + 2 + 2 * MOST_MODES  # of felt, of joints that give, of a string
Z, Z1, Z_RATE, Z_FADE, Z_EASE, Z_INPUT, Z_WEIGHT, AUDIT_Z = (LANE_SIZE + MOST_MEMORIES * k for k in range(8))
# state, at the end of the step, its rate (1/s), d rate / d state, 1 / (1/(gamma h) - that), d rate / d input,
# error of a speed that one unit of it is worth, state at which energies are asked for
Z_U = LANE_SIZE + MOST_MEMORIES * 8  # (MAX_STAGES, MOST_MEMORIES) stages
Z_PUSH = Z_U + MAX_STAGES * MOST_MEMORIES  # (MOST_FELT, LINKS) change of each joint's force by the state
Z_TURN = Z_PUSH + LINKS * MOST_FELT  # (MOST_FELT, LINKS) d rate / d angle of each joint
Z_SPEED = Z_TURN + LINKS * MOST_FELT  # (MOST_FELT, LINKS) d rate / d speed of each joint
# a string: time of the state (s), how many modes, 1 while they are stepped, how far it reaches (m), force of contact
# (N), its derivatives by way and rate, share of a change of it that is left when the modes gave way
NOW, S_COUNT, S_AWAKE, S_REACH, S_FORCE, S_HARD, S_LOSSY, S_SHARE = range(
    Z_SPEED + LINKS * MOST_FELT, Z_SPEED + LINKS * MOST_FELT + 8
)
# direction of the contact's force by joint, its derivatives by angle and by speed
S_ALONG, S_ANGLES, S_SPEEDS = (NOW + 8 + LINKS * k for k in range(3))
S_NUMBERS = NOW + 8 + 3 * LINKS  # (3, MOST_MODES) gain, stiffness, damping of each mode
S_EASE, S_BACK = (S_NUMBERS + MOST_MODES * k for k in (3, 4))
S_TURN, S_COUPLED = (S_NUMBERS + MOST_MODES * k for k in (5, 7))  # (2, MOST_MODES) at a stage; known sides
# where joints give, equations of all coordinates, their directions after the others: K, D, M, inverse
WIDE = WIDTH + MOST_PINS
P_STIFF, P_DAMP, P_MASS, P_LU = (S_COUPLED + 2 * MOST_MODES + WIDE * WIDE * k for k in range(4))
P_ACC, P_INPUT, P_ALLOWANCE = (P_LU + WIDE * WIDE + WIDE * k for k in range(3))
Z_DENSE = P_ALLOWANCE + WIDE  # (MOST_DENSE, MOST_MEMORIES) as DENSE
WITH_MEMORY = Z_DENSE + MOST_DENSE * MOST_MEMORIES
