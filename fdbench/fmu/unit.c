/* @NAME@: one feed axis of fdbench @VERSION@ as a Functional Mock-up Unit for co-simulation (FMI 2.0).
   Compile it as a shared library without contracted operations: cc -O2 -shared -fPIC -ffp-contract=off unit.c -lm */

#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

static double fd_min(double a, double b) { return b < a ? b : a; }
static double fd_max(double a, double b) { return b > a ? b : a; }
static double fd_sign(double a) { return a > 0.0 ? 1.0 : (a < 0.0 ? -1.0 : a); }
static double fd_mod(double a, double b)
{
    double rest = fmod(a, b);
    return rest != 0.0 && (rest < 0.0) != (b < 0.0) ? rest + b : rest;
}
static double fd_bits(long long a)
{
    double value;
    memcpy(&value, &a, sizeof value);
    return value;
}

@STEPPER@

#define N_IN @N_IN@
#define FIRST_OUT 100
static const int columns[] = {@COLUMNS@};
#define N_COLUMNS ((int)(sizeof columns / sizeof columns[0]))

typedef void *component;
typedef void (*logger)(void *, const char *, int, const char *, const char *, ...);
typedef struct {
    logger log;
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void (*finished)(void *, int);
    void *environment;
} callbacks;
enum { OK, WARNING, DISCARD, ERROR, FATAL, PENDING };

typedef struct {
    double w[N_ROWS], in[N_IN + 1], out[N_OUT]; /* the last input is the position at the start */
    char name[128];
    logger log;
    void *environment;
} unit;

static int say(unit *u, int status, const char *words)
{
    if (u->log)
        u->log(u->environment, u->name, status, "error", "%s", words);
    return status;
}

static void place(unit *u)
{
    double start = u->in[N_IN];
    memcpy(u->w, initial, sizeof initial);
    memset(u->out, 0, sizeof u->out);
    u->w[X_M] = u->w[X_T] = u->w[BACK_1] = u->w[BACK_2] = u->w[LAST_MOTOR] = u->w[LAST_TABLE] = start;
    u->out[OUT_MOTOR] = u->out[OUT_TABLE] = start;
}

static void sample(unit *u)
{
    double *w = u->w, h = PERIOD_S / SUBSTEPS;
    int step;
    if (N_IN == 3)
        w[COMMANDED_X] = u->in[0], w[COMMANDED_V] = u->in[1], w[COMMANDED_A] = u->in[2];
    else
        w[ACTION_FORCE] = u->in[0];
    measure_and_control(w, PERIOD_S);
    memcpy(u->out, w + COMMANDED_X, sizeof u->out);
    for (step = 0; step < SUBSTEPS; step++)
        integrate_substep(w, (step + 0.5) * h, PERIOD_S, h);
    w[INDEX] += 1.0;
    if (!(fabs(w[X_M]) <= w[POSITION_LIMIT] && fabs(w[V_M]) <= w[VELOCITY_LIMIT]))
        w[DIVERGED] = 1.0;
}

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }
EXPORT int fmi2SetDebugLogging(component c, int on, size_t n, const char *const names[])
{
    (void)c, (void)on, (void)n, (void)names;
    return OK;
}

EXPORT component fmi2Instantiate(const char *name, int kind, const char *guid, const char *resources,
                                 const callbacks *functions, int visible, int logging)
{
    unit *u;
    (void)resources, (void)visible, (void)logging;
    if (kind != 1 || !guid || strcmp(guid, "@GUID@") != 0 || !(u = calloc(1, sizeof *u)))
        return NULL;
    snprintf(u->name, sizeof u->name, "%s", name ? name : "");
    if (functions) {
        u->log = functions->log;
        u->environment = functions->environment;
    }
    place(u);
    return u;
}

EXPORT void fmi2FreeInstance(component c) { free(c); }
EXPORT int fmi2SetupExperiment(component c, int has_tolerance, double tolerance, double start, int has_stop, double stop)
{
    (void)c, (void)has_tolerance, (void)tolerance, (void)start, (void)has_stop, (void)stop;
    return OK;
}
EXPORT int fmi2EnterInitializationMode(component c)
{
    (void)c;
    return OK;
}
EXPORT int fmi2ExitInitializationMode(component c)
{
    place(c);
    return OK;
}
EXPORT int fmi2Terminate(component c)
{
    (void)c;
    return OK;
}
EXPORT int fmi2Reset(component c)
{
    memset(((unit *)c)->in, 0, sizeof((unit *)c)->in);
    place(c);
    return OK;
}

EXPORT int fmi2GetReal(component c, const unsigned int r[], size_t n, double values[])
{
    unit *u = c;
    size_t k;
    for (k = 0; k < n; k++) {
        if (r[k] <= N_IN)
            values[k] = u->in[r[k]];
        else if (r[k] >= FIRST_OUT && r[k] - FIRST_OUT < (unsigned int)N_COLUMNS)
            values[k] = u->out[columns[r[k] - FIRST_OUT]];
        else
            return say(u, ERROR, "no variable of this value reference");
    }
    return OK;
}

EXPORT int fmi2SetReal(component c, const unsigned int r[], size_t n, const double values[])
{
    size_t k;
    for (k = 0; k < n; k++) {
        if (r[k] > N_IN)
            return say(c, ERROR, "only inputs and the position at the start can be set");
        ((unit *)c)->in[r[k]] = values[k];
    }
    return OK;
}

EXPORT int fmi2DoStep(component c, double time, double step, int is_final)
{
    unit *u = c;
    double n = floor(step / PERIOD_S + 0.5);
    (void)time, (void)is_final;
    if (n < 1.0 || fabs(step - n * PERIOD_S) > 1e-6 * PERIOD_S)
        return say(u, ERROR, "a communication step has to be a whole number of sampling times");
    for (; n > 0.5; n -= 1.0)
        sample(u);
    return u->w[DIVERGED] > 0.5 ? say(u, ERROR, "the axis has left its travel or its velocity limit") : OK;
}

EXPORT int fmi2CancelStep(component c) { return say(c, ERROR, "steps are not asynchronous"); }

/* What this unit does not have. */
#define NONE(name, arguments)          \
    EXPORT int name arguments          \
    {                                  \
        (void)c;                       \
        return ERROR;                  \
    }
#define EMPTY(name, type)                                                          \
    EXPORT int name(component c, const unsigned int r[], size_t n, type values[])  \
    {                                                                              \
        (void)c, (void)r, (void)values;                                            \
        return n ? ERROR : OK;                                                     \
    }
EMPTY(fmi2GetInteger, int)
EMPTY(fmi2GetBoolean, int)
EMPTY(fmi2GetString, const char *)
EMPTY(fmi2SetInteger, const int)
EMPTY(fmi2SetBoolean, const int)
EMPTY(fmi2SetString, const char *const)
NONE(fmi2GetFMUstate, (component c, void **state))
NONE(fmi2SetFMUstate, (component c, void *state))
NONE(fmi2FreeFMUstate, (component c, void **state))
NONE(fmi2SerializedFMUstateSize, (component c, void *state, size_t *size))
NONE(fmi2SerializeFMUstate, (component c, void *state, char bytes[], size_t size))
NONE(fmi2DeSerializeFMUstate, (component c, const char bytes[], size_t size, void **state))
NONE(fmi2GetDirectionalDerivative, (component c, const unsigned int u[], size_t n, const unsigned int k[], size_t m,
                                    const double a[], double b[]))
NONE(fmi2SetRealInputDerivatives, (component c, const unsigned int r[], size_t n, const int order[], const double v[]))
NONE(fmi2GetRealOutputDerivatives, (component c, const unsigned int r[], size_t n, const int order[], double v[]))
NONE(fmi2GetStatus, (component c, int kind, int *value))
NONE(fmi2GetRealStatus, (component c, int kind, double *value))
NONE(fmi2GetIntegerStatus, (component c, int kind, int *value))
NONE(fmi2GetBooleanStatus, (component c, int kind, int *value))
NONE(fmi2GetStringStatus, (component c, int kind, const char **value))
