"""Integrator of an axis: exact linear propagation, effects at the predicted midpoint, linearly implicit in velocity.

This file is a template. `compose` writes its functions into a generated module that defines the rows of `layout` and
LANES, and in which the eight port functions call the kernels of one plant's effects.
"""

# mypy: ignore-errors
# ruff: noqa: F821 - rows and ports are defined in the generated module


def propagate(w, row, i, x_m, v_m, x_t, v_t, force_m, force_t):
    """Return one row of A s + B f for lane i."""
    return (
        w[row + i] * x_m
        + w[row + LANES + i] * v_m
        + w[row + 2 * LANES + i] * x_t
        + w[row + 3 * LANES + i] * v_t
        + w[row + 4 * LANES + i] * force_m
        + w[row + 5 * LANES + i] * force_t
    )


def measure_and_control(w, calls, first_calls, period, uniform):
    """Read the encoders, log them, and set the force that is asked of the motor for the coming period."""
    for i in range(LANES):
        w[T + i] = w[INDEX + i] * period
        through = w[NOISE_THROUGH_ENCODERS + i]
        w[READ_MOTOR + i] = w[X_M + i] + through * (w[NOISE_MOTOR + i] * w[NORMAL_MOTOR + i])
        table = w[X_T + i] - w[RIGID + i] * w[OFFSET + i] - w[TABLE_LATE + i] * w[V_T + i]
        w[READ_TABLE + i] = table + through * (w[NOISE_TABLE + i] * w[NORMAL_TABLE + i])
        w[READ_HELD + i] = w[HELD + i]
    motor_encoder(w, calls, first_calls, period, X_M, V_M, READ_MOTOR, uniform)
    table_scale(w, calls, first_calls, period, X_T, V_T, READ_TABLE, uniform)
    logging(w, calls, first_calls, period, X_M, V_M, READ_HELD, uniform)
    for i in range(LANES):
        after = 1.0 - w[NOISE_THROUGH_ENCODERS + i]
        motor = w[READ_MOTOR + i] + after * (w[NOISE_MOTOR + i] * w[NORMAL_MOTOR + i])
        table = w[READ_TABLE + i] + after * (w[NOISE_TABLE + i] * w[NORMAL_TABLE + i])
        use_table = w[USE_TABLE + i] > 0.5
        v_m, v_t = w[V_M + i], w[V_T + i]
        feedback = table if use_table else motor
        of_table = w[VELOCITY_OF_TABLE + i] > 0.5
        turning = table if of_table else motor
        tachometer = (v_t if of_table else v_m) + w[NOISE_VELOCITY + i] * w[NORMAL_VELOCITY + i]
        span = w[DIFFERENCE_SPAN + i]
        back_1, back_2 = w[BACK_1 + i], w[BACK_2 + i]
        # What is not divided is divided by 1, for a division in a branch keeps lanes apart.
        differences = span > 0.5
        change = turning - (back_1 if span < 1.5 else back_2)
        rough = (change if differences else tachometer) / (max(span, 1.0) * period if differences else 1.0)
        time_constant = w[VELOCITY_FILTER + i]
        velocity = rough + (w[FILTERED + i] - rough) * (time_constant / (period + time_constant))
        commanded = w[COMMANDED_V + i] - w[VELOCITY_REFERENCE_DELAY + i] * w[COMMANDED_A + i]
        wanted = w[VELOCITY_FEEDFORWARD + i] * (commanded + w[ACTION_VELOCITY + i])
        wanted += w[POSITION_GAIN + i] * (w[COMMANDED_X + i] + w[ACTION_POSITION + i] - feedback)
        # Between two cycles of a slower position loop the last velocity that it asked for is held.
        waits, cycles = w[UNTIL_WANTED + i], w[POSITION_LOOP_CYCLES + i]
        due = waits < 0.5
        wanted = wanted if due else w[WANTED + i]
        w[WANTED + i] = wanted
        w[UNTIL_WANTED + i] = (cycles if due else waits) - 1.0
        w[FILTERED + i] = velocity
        error = wanted - velocity
        integral = w[INTEGRAL + i]
        free = w[VELOCITY_GAIN + i] * error + w[INTEGRAL_GAIN + i] * integral
        free += w[ACCELERATION_FEEDFORWARD + i] * w[COMMANDED_A + i] + w[ACTION_FORCE + i]
        limited = min(max(free, -w[FORCE_LIMIT + i]), w[FORCE_LIMIT + i])
        w[INTEGRAL + i] = integral + (error * period if limited == free else 0.0)
        w[BACK_2 + i] = back_1
        w[BACK_1 + i] = turning
        w[REQUEST + i] = limited
        w[PROCESS_SUM + i] = 0.0
        read_held, index = w[READ_HELD + i], w[INDEX + i]
        held = read_held >= 0.5 and index >= 0.5
        last_motor, last_table = w[LAST_MOTOR + i], w[LAST_TABLE + i]
        last_velocity, last_force = w[LAST_VELOCITY + i], w[LAST_FORCE + i]
        force = (limited + w[NOISE_COMMAND + i] * w[NORMAL_COMMAND + i]) * w[LOGGED_PER_N + i]
        w[HELD + i] = 1.0 if held else 0.0
        w[LAST_MOTOR + i] = last_motor if held else motor
        w[LAST_TABLE + i] = last_table if held else table
        w[LAST_VELOCITY + i] = last_velocity if held else velocity
        w[LAST_FORCE + i] = last_force if held else force


def integrate_substep(w, calls, first_calls, time_in_period, period, h, ahead, uniform):
    r"""Advance the drive by one substep.

    With the state s = (x_m, v_m, x_t, v_t), exact propagators over a full and a half substep and forces f held over
    the substep h,

    .. math::
        f^* = f_{-1} + \tfrac34 (f_{-1} - f_{-2}), \quad s_{1/2} = A_{h/2} s + B_{h/2} f^*, \quad
        (I + S G) (f - f^*) = f(s_{1/2}) - f^*, \quad s^+ = A_h s + B_h f

    where f* is the force extrapolated from the last two substeps, S holds the slopes of the two force ports and
    G = B_{h/2} restricted to the two velocities. The effects' internal states advance at the predicted velocity. The
    table's acceleration in the middle, for added masses, is its mean over the first half, plus a quarter of the change
    of what screw and linear friction contribute to it; hence a slope of 2/h times the added mass.
    Second order, with one evaluation of each kernel a substep.
    """
    for i in range(LANES):
        w[T + i] = w[INDEX + i] * period + time_in_period
        w[DELIVERED + i] = w[REQUEST + i]
    command(w, calls, first_calls, h, X_M, V_M, DELIVERED, uniform)
    for i in range(LANES):
        a = w[DELIVERED + i] - w[AHEAD_MOTOR + i]
        b = -w[AHEAD_TABLE + i]
        x_m, v_m, x_t, v_t = w[X_M + i], w[V_M + i], w[X_T + i], w[V_T + i]
        w[MID_X_M + i] = propagate(w, HALF_0, i, x_m, v_m, x_t, v_t, a, b)
        w[MID_V_M + i] = propagate(w, HALF_6, i, x_m, v_m, x_t, v_t, a, b)
        w[MID_X_T + i] = propagate(w, HALF_12, i, x_m, v_m, x_t, v_t, a, b)
        w[MID_V_T + i] = propagate(w, HALF_18, i, x_m, v_m, x_t, v_t, a, b)
        # Without a spring the table stays behind until the free part of the stretch has followed the motor.
        w[STRETCH + i] = w[MID_X_M + i] - w[MID_X_T + i] + w[RIGID + i] * (w[OFFSET + i] + w[MID_V_M + i] * h)
        w[STRETCH_FREE + i] = 0.0
        free = (propagate(w, HALF_18, i, x_m, v_m, x_t, v_t, 0.0, 0.0) - v_t) * (2.0 / h)
        trend = free - w[ACCELERATION + i]
        w[ACCELERATION_AHEAD + i] = (w[MID_V_T + i] - v_t) * (2.0 / h) + 0.25 * trend
        w[ACCELERATION + i] = free
    transmission(w, calls, first_calls, h, MID_X_M, MID_V_M, STRETCH, STRETCH_FREE, uniform)
    for i in range(LANES):
        free = w[STRETCH_FREE + i]
        # The force pair by which the free part of the stretch lowers the screw force.
        rate = (free - w[OFFSET + i]) / h
        w[U + i] = w[STIFFNESS + i] * free + w[DAMPING + i] * (rate + 0.5 * (rate - w[OFFSET_RATE + i]))
        w[OFFSET + i] = free
        w[OFFSET_RATE + i] = rate
        spring = w[STIFFNESS + i] * w[STRETCH + i] + w[DAMPING + i] * (w[MID_V_M + i] - w[MID_V_T + i])
        w[TRANSMITTED + i] = spring - w[U + i] + w[RIGID + i] * w[DELIVERED + i]
        w[F_M + i] = 0.0
        w[S_M + i] = 0.0
        w[F_T + i] = 0.0
        w[S_T + i] = 0.0
        w[ADDED_MASS + i] = 0.0
        w[PROCESS + i] = 0.0
    motor_force(w, calls, first_calls, h, MID_X_M, MID_V_M, DELIVERED, F_M, S_M, ahead, uniform)
    table_force(w, calls, first_calls, h, MID_X_T, MID_V_T, TRANSMITTED, F_T, S_T, ahead, uniform)
    table_inertia(w, calls, first_calls, h, MID_X_T, MID_V_T, ACCELERATION_AHEAD, F_T, ADDED_MASS, ahead, uniform)
    for i in range(LANES):
        w[S_T + i] += w[ADDED_MASS + i] * (2.0 / h)
        d_m = w[F_M + i] - w[U + i] - w[AHEAD_MOTOR + i]
        d_t = w[F_T + i] + w[U + i] - w[AHEAD_TABLE + i]
        a_11 = 1.0 + w[S_M + i] * w[HALF_10 + i]
        a_12 = w[S_M + i] * w[HALF_11 + i]
        a_21 = w[S_T + i] * w[HALF_22 + i]
        a_22 = 1.0 + w[S_T + i] * w[HALF_23 + i]
        scale = 1.0 / (a_11 * a_22 - a_12 * a_21)
        force_m = w[AHEAD_MOTOR + i] + (a_22 * d_m - a_12 * d_t) * scale
        force_t = w[AHEAD_TABLE + i] + (a_11 * d_t - a_21 * d_m) * scale
        w[AHEAD_MOTOR + i] = force_m + 0.75 * (force_m - w[F_MOTOR + i])
        w[AHEAD_TABLE + i] = force_t + 0.75 * (force_t - w[F_TABLE + i])
        w[F_MOTOR + i] = force_m
        w[F_TABLE + i] = force_t
        a = w[DELIVERED + i] - force_m
        b = -force_t
        x_m, v_m, x_t, v_t = w[X_M + i], w[V_M + i], w[X_T + i], w[V_T + i]
        w[X_M + i] = propagate(w, FULL_0, i, x_m, v_m, x_t, v_t, a, b)
        w[V_M + i] = propagate(w, FULL_6, i, x_m, v_m, x_t, v_t, a, b)
        w[X_T + i] = propagate(w, FULL_12, i, x_m, v_m, x_t, v_t, a, b)
        w[V_T + i] = propagate(w, FULL_18, i, x_m, v_m, x_t, v_t, a, b)
        w[PROCESS_SUM + i] += w[PROCESS + i]


def advance(
    blocks, first, n_samples, substeps, period, calls, first_calls, ahead, reference, logged, normal, uniform, out
):
    """Advance every lane of every block by ``n_samples`` control periods.

    Parameters
    ----------
    blocks : (n_blocks, n_rows * LANES) array, changed in place
    first, n_samples, substeps : int
        Where the random numbers begin; control periods; integration substeps in each.
    period : float
        Control period, s.
    calls : (n_calls, 4) array of int
        Effects that any lane has, by port: case, first row of parameters and of internal states, random number.
    first_calls : (n_ports + 1,) array of int
        Where those of each port begin.
    ahead : (n_calls, 3, n) array, written
        Value and slope of forces of time alone at the n >= substeps of a sample, and 1 where lanes have them alike.
    reference : (n_reference, 3) array
        Commanded position (m), velocity (m/s) and acceleration (m/s^2); a lane's own begin at its first row.
    logged : (n_columns,) array of int
        What is handed out of the rows from COMMANDED_X on.
    normal : (n_blocks, n_random, NORMAL_COLUMNS * LANES) array
        Random numbers of each sample; n_random of 0 where nothing is noisy.
    uniform : (n_blocks, n_random, n, LANES) array
    out : (n_samples, n_columns, n_blocks, LANES) array, written
    """
    h = period / substeps
    for block in range(blocks.shape[0]):
        w = blocks[block]
        prepare(w, calls, h)
        for k in range(n_samples):
            # Loops that touch other arrays stand alone: lanes of the others run as vectors.
            for i in range(LANES):
                row = int(w[INDEX + i] + w[FIRST_ROW + i])
                w[COMMANDED_X + i] = reference[row, 0] + w[DISPLACEMENT + i]
                w[COMMANDED_V + i] = reference[row, 1]
                w[COMMANDED_A + i] = reference[row, 2]
            for place in range(NORMAL_COLUMNS * LANES if normal.shape[1] > 0 else 0):
                w[NORMAL_MOTOR + place] = normal[block, first + k, place]
            flat = uniform[block, first + k]
            measure_and_control(w, calls, first_calls, period, flat)
            look_ahead(w, calls, period, h, ahead)
            for step in range(substeps):
                integrate_substep(w, calls, first_calls, (step + 0.5) * h, period, h, ahead[:, :, step], flat)
            for i in range(LANES):
                kick = w[NOISE_EQUATION + i] * w[NORMAL_EQUATION + i]
                w[V_M + i] += kick
                w[V_T + i] += kick
                w[INDEX + i] += 1.0
                w[DISTURBANCE + i] = w[PROCESS_SUM + i] / substeps
                inside = (abs(w[X_M + i]) <= w[POSITION_LIMIT + i]) & (abs(w[V_M + i]) <= w[VELOCITY_LIMIT + i])
                diverged = w[DIVERGED + i]
                w[DIVERGED + i] = diverged if inside else 1.0
            for column in range(len(logged)):
                place = COMMANDED_X + logged[column] * LANES
                values = w[place : place + LANES]
                for i in range(LANES):
                    out[k, column, block, i] = values[i]
