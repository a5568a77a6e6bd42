component fdbench_axis "One feed axis, of one mass or of two with a screw between them, that sticks and slides";
description """
What a motor, a screw and a table do with a force, in sub-steps of the servo period (semi-implicit Euler). Positions at
the pins are in mm and forces in N, as in a configuration of LinuxCNC in mm; parameters are in SI units. Parameters that
are 0 by default are of effects that the axis has not.
""";
author "fdbench";
license "MIT";

pin in float force "Asked of the motor, N";
pin out float position "Reading of the motor's encoder, mm";
pin out float table_position "Reading of the table's scale, mm; without a screw that of the encoder";

param rw float mass = 1.0 "Of all that moves without a screw, else of the motor, kg";
param rw float table_mass = 1.0 "Behind the screw, kg";
param rw float stiffness = 0.0 "Of the screw, N/m; 0: none";
param rw float damping = 0.0 "Of the screw, N s/m";
param rw float force_ratio = 1.0 "Force of the motor over what was asked";
param rw float viscous = 0.0 "Friction over speed, N s/m";
param rw float coulomb = 0.0 "Friction, N";
param rw float width = 0.0 "Speed over which friction turns its sign, m/s; 0: it sticks";
param rw float weight = 0.0 "Force against positive motion, N";
param rw float stribeck = 0.0 "Friction at rest beyond that in motion, N";
param rw float stribeck_speed = 1.0 "m/s";
param rw float direction = 0.0 "Share by which friction is larger forwards and smaller backwards";
param rw float cable = 0.0 "Spring to the origin, N/m";
param rw float cogging = 0.0 "N";
param rw float pitch = 1.0 "Of the cogging, m";
param rw float periodic = 0.0 "Force of a sine in time, N";
param rw float frequency = 1.0 "Of the sine or square wave, Hz";
param rw float phase = 0.0 "Of cogging, sine or square wave, rad";
param rw float square = 0.0 "Force of a square wave in time, N";
param rw unsigned dead_cycles = 0 "Servo periods by which the force is late, at most 15";
param rw float lag = 0.0 "Time constant of the force, s";
param rw float knee = 0.0 "Force to which the motor saturates, N; 0: it does not";
param rw float count = 0.0 "Of the encoder, m; 0: no steps";
param rw float bump = 0.0 "More friction at one place, N";
param rw float bump_place = 0.0 "m";
param rw float bump_width = 1.0 "m";
param rw float hysteresis = 0.0 "Sum of two elements that yield before they slip, N";
param rw float hysteresis_way = 1.0 "Over which the first yields, and the second in three times that, m";
param rw float noise = 0.0 "Standard deviation of each reading, m";
param rw float rub = 0.0 "Standard deviation of a force that comes and goes in 10 ms, N";
param rw float wander = 0.0 "Share by which friction changes within some seconds";
param rw unsigned seed = 1;

variable double motor_x;
variable double motor_v;
variable double table_x;
variable double table_v;
variable double lagged;
variable double queue[16];
variable unsigned cycle;
variable double stop[2];
variable double rubbing;
variable double wandering;
variable double seconds;
variable unsigned chance[2];

function _ fp;
;;
#include <rtapi_math.h>

#define STEPS 50
#define TURN 6.283185307179586
#define STANDING 1e-6 /* m/s, below which what sticks stands */

/* A number of unit variance: sum of twelve even ones of a multiply-with-carry generator. */
static double normal(unsigned *state) {
    double sum = -6.0;
    int i;
    for (i = 0; i < 12; i++) {
        state[0] = 36969u * (state[0] & 65535u) + (state[0] >> 16);
        state[1] = 18000u * (state[1] & 65535u) + (state[1] >> 16);
        sum += ((unsigned)((state[0] << 16) + state[1]) + 0.5) / 4294967296.0;
    }
    return sum;
}

/* What a sensor of so fine a grid (m; 0: none) shows of a place (m), in mm. */
static double shown(double grid, double place) { return 1e3 * (grid > 0.0 ? grid * floor(place / grid + 0.5) : place); }

FUNCTION(_) {
    const double h = fperiod / STEPS;
    const int is_elastic = stiffness > 0.0;
    const double moved_mass = is_elastic ? table_mass : mass;
    double *x = is_elastic ? &table_x : &motor_x;
    double *v = is_elastic ? &table_v : &motor_v;
    double asked, outer;
    int step, i;

    if (cycle == 0) {
        chance[0] = 362436069u ^ (seed * 2654435761u);
        chance[1] = 521288629u ^ (seed * 40503u);
        for (i = 0; i < 20; i++) normal(chance);
    }
    queue[cycle % 16] = force;
    asked = queue[(cycle - (dead_cycles < 16 ? dead_cycles : 15)) % 16];
    cycle++;
    rubbing += fperiod / 0.01 * (-rubbing) + sqrt(2.0 * fperiod / 0.01) * normal(chance);
    wandering += fperiod / 3.0 * (-wandering) + sqrt(2.0 * fperiod / 3.0) * normal(chance);
    outer = weight + rub * rubbing;

    for (step = 0; step < STEPS; step++) {
        double delivered, pull, slip, side, level, before = *x;

        lagged = lag > 0.0 ? lagged + (asked - lagged) * (1.0 - exp(-h / lag)) : asked;
        delivered = force_ratio * (knee > 0.0 ? knee * tanh(lagged / knee) : lagged);
        delivered -= cogging * sin(TURN * motor_x / pitch + phase);
        seconds += h;

        pull = delivered;
        if (is_elastic) {
            pull = stiffness * (motor_x - table_x) + damping * (motor_v - table_v);
            motor_v += h * (delivered - pull) / mass;
            motor_x += h * motor_v;
        }
        side = *v > 0.0 || (*v == 0.0 && pull > outer) ? 1.0 + direction : 1.0 - direction;
        pull -= outer + cable * *x + stop[0] + stop[1] + viscous * side * *v;
        if (periodic != 0.0) pull -= periodic * sin(TURN * frequency * seconds + phase);
        if (square != 0.0) pull -= square * (sin(TURN * frequency * seconds + phase) > 0.0 ? 1.0 : -1.0);

        slip = *v / stribeck_speed;
        level = coulomb * side * (1.0 + wander * wandering) + stribeck * exp(-slip * slip);
        if (bump != 0.0) {
            double away = (*x - bump_place) / bump_width;
            level += bump * exp(-away * away);
        }
        if (width > 0.0) {
            *v += h * (pull - level * tanh(*v / width)) / moved_mass;
        } else if (fabs(*v) < STANDING && fabs(pull) <= level) {
            *v = 0.0;
        } else {
            double way = fabs(*v) < STANDING ? (pull > 0.0 ? 1.0 : -1.0) : (*v > 0.0 ? 1.0 : -1.0);
            double next = *v + h * (pull - way * level) / moved_mass;
            *v = next * way < 0.0 && fabs(pull) <= level ? 0.0 : next;
        }
        *x += h * *v;
        if (hysteresis != 0.0)
            for (i = 0; i < 2; i++) {
                double most = hysteresis * (i ? 0.4 : 0.6);
                stop[i] += most / (hysteresis_way * (i ? 3.0 : 1.0)) * (*x - before);
                stop[i] = fmin(fmax(stop[i], -most), most);
            }
    }
    position = shown(count, motor_x + noise * normal(chance));
    table_position = is_elastic ? shown(0.0, table_x + noise * normal(chance)) : position;
}
