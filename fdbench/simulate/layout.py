"""Rows of a block: every quantity of the simulation, one row each, the instances (lanes) side by side in a row.

One flat block with rows at constant distance is what lets the compiler run lanes side by side; the generated stepper
defines each name below as the row's first element. Rows of parameters and internal states of the effects follow.
"""

ROWS: tuple[str, ...] = (
    # State of the drive: position and velocity of motor side and table, effect forces of the last substep, the same
    # extrapolated to the middle of the first half of the next one, free part of the stretch, its rate, acceleration of
    # the table.
    *("X_M", "V_M", "X_T", "V_T", "F_MOTOR", "F_TABLE", "AHEAD_MOTOR", "AHEAD_TABLE", "OFFSET"),
    *("OFFSET_RATE", "ACCELERATION"),
    # State of the controller: integral of the velocity error, last two readings, filtered velocity, what the position
    # loop asks for and cycles until it does so anew, sample number.
    *("INTEGRAL", "BACK_1", "BACK_2", "FILTERED", "WANTED", "UNTIL_WANTED", "INDEX"),
    # What is handed out of each sample, in the order of OUT: command, last row of the log, process force, flags.
    *("COMMANDED_X", "COMMANDED_V", "LAST_MOTOR", "LAST_TABLE", "LAST_VELOCITY", "LAST_FORCE"),
    *("DISTURBANCE", "HELD", "DIVERGED"),
    # Propagators over half a substep and a whole one: rows of A | B for X_M, V_M, X_T, V_T.
    *(f"HALF_{i}" for i in range(24)),
    *(f"FULL_{i}" for i in range(24)),
    # Scalars of the plant, limits, standard deviations of the noises.
    *("STIFFNESS", "DAMPING", "RIGID", "POSITION_LIMIT", "VELOCITY_LIMIT", "LOGGED_PER_N"),
    *("NOISE_MOTOR", "NOISE_TABLE", "NOISE_VELOCITY", "NOISE_EQUATION", "NOISE_COMMAND"),
    "NOISE_THROUGH_ENCODERS",
    # By how much the table is read late, of which its reading has the first order.
    "TABLE_LATE",
    # Row of the reference with which a lane begins, and how far its positions are displaced; controller.
    *("FIRST_ROW", "DISPLACEMENT", "USE_TABLE", "DIFFERENCE_SPAN", "POSITION_GAIN"),
    *("VELOCITY_OF_TABLE", "VELOCITY_FILTER", "POSITION_LOOP_CYCLES"),
    *("VELOCITY_FEEDFORWARD", "VELOCITY_REFERENCE_DELAY", "VELOCITY_GAIN", "INTEGRAL_GAIN"),
    *("ACCELERATION_FEEDFORWARD", "FORCE_LIMIT"),
    # Action: deviation from the scenario's own command.
    *("ACTION_POSITION", "ACTION_VELOCITY", "ACTION_FORCE"),
    # Scratch of one substep.
    *("T", "MID_X_M", "MID_V_M", "MID_X_T", "MID_V_T", "U", "F_M", "S_M", "F_T", "S_T", "STRETCH", "STRETCH_FREE"),
    *("ACCELERATION_AHEAD", "ADDED_MASS", "DELIVERED", "TRANSMITTED", "PROCESS", "PROCESS_SUM", "REQUEST"),
    *("COMMANDED_A", "READ_MOTOR", "READ_TABLE", "READ_HELD"),
    # Random numbers of the sample.
    *("NORMAL_MOTOR", "NORMAL_TABLE", "NORMAL_VELOCITY", "NORMAL_EQUATION", "NORMAL_COMMAND"),
)

FIRST_FREE_ROW = len(ROWS)
STATE_ROWS = ROWS[: ROWS.index("HALF_0")]

# Columns of the output, one row for each sample; what only the simulation knows comes last.
OUT_REFERENCE_POSITION, OUT_REFERENCE_VELOCITY, OUT_MOTOR, OUT_TABLE, OUT_VELOCITY, OUT_FORCE = range(6)
OUT_DISTURBANCE, OUT_HELD, OUT_DIVERGED = range(6, 9)
OUT_COLUMNS = 9
NORMAL_COLUMNS = 5  # standard normal numbers of a sample: motor, table and velocity reading, equation, command
