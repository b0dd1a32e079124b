"""Where the loop in lanes keeps its numbers: rows of lanes, and integers per lane."""

from model.kernels.workspace import WIDTH

# rows of the loop's numbers
TIME, END, WANTED_STEP, STEP, FITTED, SLOPE, START_INPUT, ANGLE, SPEED, REST, LONGEST, AT, AT_REST = range(13)
FRACTION, NEXT_STEP, EVALUATED = 13, 14, 15  # of a step where an output lies; the next one; contacts evaluated
DENSE = 16  # (MOST_DENSE, 2, WIDTH) sums over the stages that the state inside a step is made of
MOST_DENSE = 4
ROW = DENSE + MOST_DENSE * 2 * WIDTH  # (2, WIDTH) state inside a step
N_NUMBERS = ROW + 2 * WIDTH

# integers of each lane
MEMBER, TRIED, POINT, ROWS_DONE, FIRST, LAST, FIRST_OUT, N_OUT, MOST, ANGLES_AT, SPEEDS_AT, MEMORIES_AT = range(12)
N_WHOLE = 12
