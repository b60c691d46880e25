/* The functions of FMI 2.0 for co-simulation. */
#include "instance.h"

typedef void Logger2(void *, const char *, int, const char *, const char *, ...);
typedef struct {
    Logger2 *logger;
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void (*finished)(void *, int);
    void *environment;
} Callbacks;

/* The logger takes its text for a format of printf. */
static void emit2(const Instance *c, int status, const char *category, const char *text)
{
    Logger2 *logger = (Logger2 *)c->logger;
    char *format = malloc(2 * strlen(text) + 1), *to = format;
    if (logger != NULL && format != NULL) {
        for (; *text; *to++ = *text++)
            if (*text == '%') *to++ = '%';
        *to = '\0';
        logger(c->environment, c->name, status, category, format);
    }
    free(format);
}

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }

EXPORT void *fmi2Instantiate(const char *name, int type, const char *guid, const char *location,
                             const Callbacks *callbacks, int visible, int logging)
{
    (void)visible, (void)logging; /* errors are logged, with or without debugging */
    Instance given = {.emit = emit2, .name = (char *)name, .environment = callbacks ? callbacks->environment : NULL};
    given.kind = COSIMULATION_2;
    given.logger = callbacks ? (void *)callbacks->logger : NULL;
    if (type != 1) {
        emit2(&given, ERROR, "logStatusError", "this FMU is for co-simulation only");
        return NULL;
    }
    char *path = location ? path_of(location) : NULL;
    Instance *c = opened(&given, name, guid, path);
    free(path);
    return c;
}

EXPORT void fmi2FreeInstance(Instance *c) { closed(c); }

EXPORT int fmi2SetDebugLogging(Instance *c, int on, size_t n, const char *const categories[])
{
    ALLOWED(ALWAYS);
    (void)on, (void)n, (void)categories; /* there are no debug messages */
    return OK;
}

EXPORT int fmi2SetupExperiment(Instance *c, int tolerance_defined, double tolerance, double start, int stop_defined,
                               double stop)
{
    ALLOWED(SETUP);
    (void)stop_defined, (void)stop;
    return setup(c, start, tolerance_defined ? tolerance : 0.0);
}

EXPORT int fmi2EnterInitializationMode(Instance *c)
{
    ALLOWED(ENTER_INITIALIZATION);
    return entered(c, OK, INITIALIZATION);
}

EXPORT int fmi2ExitInitializationMode(Instance *c)
{
    ALLOWED(EXIT_INITIALIZATION);
    c->phase = FAILED;  /* stays where the next line fails */
    return entered(c, initialize(c), STEP);
}

EXPORT int fmi2Terminate(Instance *c)
{
    ALLOWED(TERMINATE);
    c->phase = TERMINATED; /* whatever it returns */
    return terminate(c);
}

EXPORT int fmi2Reset(Instance *c)
{
    ALLOWED(ALWAYS);
    return entered(c, reset(c), INSTANTIATED);
}

EXPORT int fmi2GetReal(Instance *c, const uint32_t vr[], size_t n, double v[])
{
    ALLOWED(GET);
    return get_numbers(c, vr, n, v, n);
}

EXPORT int fmi2SetReal(Instance *c, const uint32_t vr[], size_t n, const double v[])
{
    ALLOWED(SET);
    return set_numbers(c, vr, n, v, n);
}

static int get_integers(Instance *c, const uint32_t vr[], size_t n, int v[])
{
    double *numbers = calloc(n + 1, sizeof *numbers);  /* none is still a block */
    if (numbers == NULL) return ERROR;
    int status = get_numbers(c, vr, n, numbers, n);
    for (size_t i = 0; i < n && status < DISCARD; i++) v[i] = (int)numbers[i];
    free(numbers);
    return status;
}

static int set_integers(Instance *c, const uint32_t vr[], size_t n, const int v[])
{
    double *numbers = calloc(n + 1, sizeof *numbers);
    if (numbers == NULL) return ERROR;
    for (size_t i = 0; i < n; i++) numbers[i] = v[i];
    int status = set_numbers(c, vr, n, numbers, n);
    free(numbers);
    return status;
}

EXPORT int fmi2GetInteger(Instance *c, const uint32_t vr[], size_t n, int v[])
{
    ALLOWED(GET);
    return get_integers(c, vr, n, v);
}

EXPORT int fmi2SetInteger(Instance *c, const uint32_t vr[], size_t n, const int v[])
{
    ALLOWED(SET);
    return set_integers(c, vr, n, v);
}

EXPORT int fmi2GetBoolean(Instance *c, const uint32_t vr[], size_t n, int v[])
{
    ALLOWED(GET);
    int status = get_integers(c, vr, n, v);
    for (size_t i = 0; i < n && status < DISCARD; i++) v[i] = v[i] != 0;
    return status;
}

EXPORT int fmi2SetBoolean(Instance *c, const uint32_t vr[], size_t n, const int v[])
{
    ALLOWED(SET);
    return set_integers(c, vr, n, v);
}

EXPORT int fmi2GetString(Instance *c, const uint32_t vr[], size_t n, const char *v[])
{
    ALLOWED(GET);
    return get_texts(c, vr, n, v, n);
}

EXPORT int fmi2SetString(Instance *c, const uint32_t vr[], size_t n, const char *const v[])
{
    ALLOWED(SET);
    return set_texts(c, vr, n, v, n);
}

EXPORT int fmi2GetFMUstate(Instance *c, void **state)
{
    ALLOWED(ALWAYS);
    return get_state(c, state);
}

EXPORT int fmi2SetFMUstate(Instance *c, void *state)
{
    ALLOWED(ALWAYS);
    return set_state(c, state);
}

EXPORT int fmi2FreeFMUstate(Instance *c, void **state)
{
    ALLOWED(ALWAYS);
    return free_state(c, state);
}

EXPORT int fmi2SerializedFMUstateSize(Instance *c, void *state, size_t *size)
{
    ALLOWED(ALWAYS);
    return state_size(c, state, size);
}


EXPORT int fmi2SerializeFMUstate(Instance *c, void *state, char bytes[], size_t size)
{
    ALLOWED(ALWAYS);
    return state_to_bytes(c, state, bytes, size);
}

EXPORT int fmi2DeSerializeFMUstate(Instance *c, const char bytes[], size_t size, void **state)
{
    ALLOWED(ALWAYS);
    return state_from_bytes(c, bytes, size, state);
}

EXPORT int fmi2GetDirectionalDerivative(Instance *c, const uint32_t unknown[], size_t n_unknown, const uint32_t known[],
                                        size_t n_known, const double dv[], double dz[])
{
    ALLOWED(DIFFERENTIATE);
    return directional_derivative(c, unknown, n_unknown, known, n_known, dv, n_known, dz, n_unknown);
}

EXPORT int fmi2SetRealInputDerivatives(Instance *c, const uint32_t vr[], size_t n, const int order[], const double v[])
{
    (void)vr, (void)n, (void)order, (void)v;
    return unsupported(c, "fmi2SetRealInputDerivatives");
}

EXPORT int fmi2GetRealOutputDerivatives(Instance *c, const uint32_t vr[], size_t n, const int order[], double v[])
{
    (void)vr, (void)n, (void)order, (void)v;
    return unsupported(c, "fmi2GetRealOutputDerivatives");
}

EXPORT int fmi2DoStep(Instance *c, double t, double h, int no_set_state)
{
    ALLOWED(DO_STEP);
    (void)no_set_state;
    int status = step(c, t, h);
    if (status == DISCARD) c->phase = STEP_FAILED;
    return status;
}

EXPORT int fmi2CancelStep(Instance *c) { return unsupported(c, "fmi2CancelStep"); }

EXPORT int fmi2GetStatus(Instance *c, int kind, int *value)
{
    ALLOWED(GET_STATUS);
    if (kind != 0) return unsupported(c, "fmi2GetStatus of another kind than fmi2DoStepStatus");
    *value = c->last;
    return OK;
}

EXPORT int fmi2GetRealStatus(Instance *c, int kind, double *value)
{
    ALLOWED(GET_STATUS);
    if (kind != 2) return unsupported(c, "fmi2GetRealStatus of another kind than fmi2LastSuccessfulTime");
    *value = c->time;
    return OK;
}

EXPORT int fmi2GetIntegerStatus(Instance *c, int kind, int *value)
{
    (void)kind, (void)value;
    return unsupported(c, "fmi2GetIntegerStatus");
}

EXPORT int fmi2GetBooleanStatus(Instance *c, int kind, int *value)
{
    ALLOWED(GET_STATUS);
    if (kind != 3) return unsupported(c, "fmi2GetBooleanStatus of another kind than fmi2Terminated");
    *value = 0; /* this FMU never ends a simulation: a discarded step is a step that was not made */
    return OK;
}

EXPORT int fmi2GetStringStatus(Instance *c, int kind, const char **value)
{
    (void)kind, (void)value;
    return unsupported(c, "fmi2GetStringStatus");
}
