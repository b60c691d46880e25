/* The functions of FMI 3.0 for co-simulation and Model Exchange; those of clocks and binaries are not supported. */
#include "instance.h"

#include <stdbool.h>

typedef void Logger3(void *, int, const char *, const char *);
typedef uint32_t Reference;

static void emit3(const Instance *c, int status, const char *category, const char *text)
{
    Logger3 *logger = (Logger3 *)c->logger;
    if (logger != NULL) logger(c->environment, status, category, text);
}

EXPORT const char *fmi3GetVersion(void) { return "3.0"; }

EXPORT int fmi3SetDebugLogging(Instance *c, bool on, size_t n, const char *const categories[])
{
    ALLOWED(ALWAYS);
    (void)on, (void)n, (void)categories; /* there are no debug messages */
    return OK;
}

/* -- life cycle ---------------------------------------------------------------------------------------------------- */
EXPORT Instance *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool visible,
                                             bool logging, bool events, bool early, const Reference intermediate[],
                                             size_t n, void *environment, Logger3 *logger, void *update)
{
    (void)visible, (void)logging, (void)events, (void)intermediate, (void)n, (void)update;
    Instance given = {.emit = emit3, .environment = environment, .logger = (void *)logger, .early = early};
    given.kind = COSIMULATION_3;
    return opened(&given, name, token, resources);
}

EXPORT Instance *fmi3InstantiateModelExchange(const char *name, const char *token, const char *resources, bool visible,
                                              bool logging, void *environment, Logger3 *logger)
{
    (void)visible, (void)logging;
    Instance given = {.emit = emit3, .environment = environment, .logger = (void *)logger, .kind = EXCHANGE_3};
    return opened(&given, name, token, resources);
}

EXPORT Instance *fmi3InstantiateScheduledExecution(const char *name, const char *token, const char *resources,
                                                   bool visible, bool logging, void *environment, Logger3 *logger,
                                                   void *update, void *on, void *off)
{
    (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)update, (void)on, (void)off;
    Instance given = {.emit = emit3, .environment = environment, .logger = (void *)logger};
    unsupported(&given, "fmi3InstantiateScheduledExecution");
    return NULL;
}

EXPORT void fmi3FreeInstance(Instance *c) { closed(c); }

EXPORT int fmi3EnterInitializationMode(Instance *c, bool tolerance_defined, double tolerance, double start,
                                       bool stop_defined, double stop)
{
    ALLOWED(ENTER_INITIALIZATION);
    (void)stop_defined, (void)stop;
    return entered(c, setup(c, start, tolerance_defined ? tolerance : 0.0), INITIALIZATION);
}

EXPORT int fmi3ExitInitializationMode(Instance *c)
{
    ALLOWED(EXIT_INITIALIZATION);
    c->phase = FAILED;  /* stays where the next line fails */
    return entered(c, initialize(c), c->kind == EXCHANGE_3 ? EVENT : STEP);
}

EXPORT int fmi3Terminate(Instance *c)
{
    ALLOWED(TERMINATE);
    c->phase = TERMINATED; /* whatever it returns */
    return terminate(c);
}

EXPORT int fmi3Reset(Instance *c)
{
    ALLOWED(ALWAYS);
    return entered(c, reset(c), INSTANTIATED);
}

#define MODE(name, call, phase)                                                                                        \
    EXPORT int name(Instance *c)                                                                                       \
    {                                                                                                                  \
        ALLOWED(call);                                                                                                 \
        return entered(c, OK, phase);                                                                                  \
    }
MODE(fmi3EnterConfigurationMode, ENTER_CONFIGURATION, CONFIGURATION)
MODE(fmi3ExitConfigurationMode, EXIT_CONFIGURATION, INSTANTIATED)
MODE(fmi3EnterEventMode, ENTER_EVENT, EVENT)
MODE(fmi3EnterContinuousTimeMode, ENTER_CONTINUOUS, CONTINUOUS)
MODE(fmi3EvaluateDiscreteStates, UPDATE, EVENT)
EXPORT int fmi3EnterStepMode(Instance *c) { return unsupported(c, "fmi3EnterStepMode (there is no event mode)"); }

/* -- variables: numbers of every type pass as double precision ------------------------------------------------------- */
EXPORT int fmi3GetFloat64(Instance *c, const Reference vr[], size_t n, double v[], size_t size)
{
    ALLOWED(GET);
    return get_numbers(c, vr, n, v, size);
}

EXPORT int fmi3SetFloat64(Instance *c, const Reference vr[], size_t n, const double v[], size_t size)
{
    ALLOWED(SET);
    return set_numbers(c, vr, n, v, size);
}

EXPORT int fmi3GetDirectionalDerivative(Instance *c, const Reference unknowns[], size_t n, const Reference knowns[],
                                        size_t m, const double seed[], size_t size_of_seed, double values[], size_t size)
{
    ALLOWED(DIFFERENTIATE);
    return directional_derivative(c, unknowns, n, knowns, m, seed, size_of_seed, values, size);
}

#define NUMBERS(kind, type)                                                                                            \
    EXPORT int fmi3Get##kind(Instance *c, const Reference vr[], size_t n, type v[], size_t size)                       \
    {                                                                                                                  \
        ALLOWED(GET);                                                                                                  \
        double *numbers = calloc(size + 1, sizeof *numbers);                                                           \
        if (numbers == NULL) return ERROR;                                                                             \
        int status = get_numbers(c, vr, n, numbers, size);                                                             \
        for (size_t i = 0; i < size && status < DISCARD; i++) v[i] = (type)numbers[i];                                 \
        free(numbers);                                                                                                 \
        return status;                                                                                                 \
    }                                                                                                                  \
    EXPORT int fmi3Set##kind(Instance *c, const Reference vr[], size_t n, const type v[], size_t size)                 \
    {                                                                                                                  \
        ALLOWED(SET);                                                                                                  \
        double *numbers = calloc(size + 1, sizeof *numbers);                                                           \
        if (numbers == NULL) return ERROR;                                                                             \
        for (size_t i = 0; i < size; i++) numbers[i] = (double)v[i];                                                   \
        int status = set_numbers(c, vr, n, numbers, size);                                                             \
        free(numbers);                                                                                                 \
        return status;                                                                                                 \
    }
NUMBERS(Float32, float)
NUMBERS(Int8, int8_t)
NUMBERS(UInt8, uint8_t)
NUMBERS(Int16, int16_t)
NUMBERS(UInt16, uint16_t)
NUMBERS(Int32, int32_t)
NUMBERS(UInt32, uint32_t)
NUMBERS(Int64, int64_t)
NUMBERS(UInt64, uint64_t)
NUMBERS(Boolean, bool)

EXPORT int fmi3GetString(Instance *c, const Reference vr[], size_t n, const char *v[], size_t size)
{
    ALLOWED(GET);
    return get_texts(c, vr, n, v, size);
}

EXPORT int fmi3SetString(Instance *c, const Reference vr[], size_t n, const char *const v[], size_t size)
{
    ALLOWED(SET);
    return set_texts(c, vr, n, v, size);
}

/* -- states -------------------------------------------------------------------------------------------------------- */
EXPORT int fmi3GetFMUState(Instance *c, void **state)
{
    ALLOWED(ALWAYS);
    return get_state(c, state);
}

EXPORT int fmi3SetFMUState(Instance *c, void *state)
{
    ALLOWED(ALWAYS);
    return set_state(c, state);
}

EXPORT int fmi3FreeFMUState(Instance *c, void **state)
{
    ALLOWED(ALWAYS);
    return free_state(c, state);
}

EXPORT int fmi3SerializedFMUStateSize(Instance *c, void *state, size_t *size)
{
    ALLOWED(ALWAYS);
    return state_size(c, state, size);
}


EXPORT int fmi3SerializeFMUState(Instance *c, void *state, char bytes[], size_t size)
{
    ALLOWED(ALWAYS);
    return state_to_bytes(c, state, bytes, size);
}

EXPORT int fmi3DeserializeFMUState(Instance *c, const char bytes[], size_t size, void **state)
{
    ALLOWED(ALWAYS);
    return state_from_bytes(c, bytes, size, state);
}

/* -- co-simulation ------------------------------------------------------------------------------------------------- */
EXPORT int fmi3DoStep(Instance *c, double t, double h, bool no_set_state, bool *event, bool *ended, bool *early,
                      double *reached)
{
    ALLOWED(DO_STEP);
    (void)no_set_state;
    int status = step(c, t, h);
    *event = *ended = false; /* a discarded step is a step that was not made: the simulation has not ended */
    *reached = c->time;
    *early = status < DISCARD && c->time < t + h; /* after a contact event, where the host allows it */
    return status;
}

/* -- Model Exchange ------------------------------------------------------------------------------------------------ */
EXPORT int fmi3SetTime(Instance *c, double t)
{
    ALLOWED(SET_CONTINUOUS);
    return set_time(c, t);
}

EXPORT int fmi3SetContinuousStates(Instance *c, const double states[], size_t n)
{
    ALLOWED(SET_CONTINUOUS);
    return write_vector(c, "set_continuous_states", states, n);
}

EXPORT int fmi3GetContinuousStates(Instance *c, double v[], size_t n)
{
    ALLOWED(EVALUATE);
    return read_vector(c, "get_continuous_states", v, n);
}

EXPORT int fmi3GetContinuousStateDerivatives(Instance *c, double v[], size_t n)
{
    ALLOWED(EVALUATE);
    return read_vector(c, "get_derivatives", v, n);
}

EXPORT int fmi3GetNominalsOfContinuousStates(Instance *c, double v[], size_t n)
{
    ALLOWED(EVALUATE);
    return read_vector(c, "get_nominals", v, n);
}

EXPORT int fmi3GetEventIndicators(Instance *c, double v[], size_t n)
{
    ALLOWED(EVALUATE);
    return read_vector(c, "get_event_indicators", v, n);
}

static int count(Instance *c, const char *method, size_t *n)
{
    double number = 0.0;
    int status = read_vector(c, method, &number, 1);
    *n = (size_t)number;
    return status;
}

EXPORT int fmi3GetNumberOfContinuousStates(Instance *c, size_t *n)
{
    ALLOWED(COUNT_STATES);
    return count(c, "number_of_states", n);
}

EXPORT int fmi3GetNumberOfEventIndicators(Instance *c, size_t *n)
{
    ALLOWED(COUNT_STATES);
    return count(c, "number_of_indicators", n);
}

EXPORT int fmi3CompletedIntegratorStep(Instance *c, bool no_set_state, bool *event, bool *ended)
{
    ALLOWED(INTEGRATED);
    (void)no_set_state;
    *event = *ended = false;
    return OK;
}

EXPORT int fmi3UpdateDiscreteStates(Instance *c, bool *again, bool *ended, bool *nominals, bool *states, bool *defined,
                                    double *next)
{
    ALLOWED(UPDATE);
    double event[3] = {0.0, 0.0, 0.0}; /* whether the simulation ends, whether an event is known, its time */
    int status = read_vector(c, "update_discrete_states", event, 3);
    *again = *nominals = false;
    *states = true; /* unchanged, but some hosts restart their integrator only where this is true */
    *ended = event[0] != 0.0;
    *defined = event[1] != 0.0;
    *next = event[2];
    return status;
}

/* -- not supported ------------------------------------------------------------------------------------------------- */
#define NOT_SUPPORTED(name, ...)                                                                                       \
    EXPORT int name(Instance *c, __VA_ARGS__) { return unsupported(c, #name); }
#ifdef __clang__
#pragma clang diagnostic ignored "-Wunused-parameter"
#else
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif
NOT_SUPPORTED(fmi3GetBinary, const Reference a[], size_t n, size_t s[], const uint8_t *v[], size_t m)
NOT_SUPPORTED(fmi3SetBinary, const Reference a[], size_t n, const size_t s[], const uint8_t *const v[], size_t m)
NOT_SUPPORTED(fmi3GetClock, const Reference a[], size_t n, bool v[])
NOT_SUPPORTED(fmi3SetClock, const Reference a[], size_t n, const bool v[])
NOT_SUPPORTED(fmi3GetNumberOfVariableDependencies, Reference a, size_t *n)
NOT_SUPPORTED(fmi3GetVariableDependencies, Reference a, size_t b[], Reference r[], size_t e[], int k[], size_t n)
NOT_SUPPORTED(fmi3GetAdjointDerivative, const Reference u[], size_t n, const Reference k[], size_t m, const double s[],
              size_t ns, double v[], size_t nv)
NOT_SUPPORTED(fmi3GetIntervalDecimal, const Reference a[], size_t n, double v[], int q[])
NOT_SUPPORTED(fmi3GetIntervalFraction, const Reference a[], size_t n, uint64_t u[], uint64_t v[], int q[])
NOT_SUPPORTED(fmi3GetShiftDecimal, const Reference a[], size_t n, double v[])
NOT_SUPPORTED(fmi3GetShiftFraction, const Reference a[], size_t n, uint64_t u[], uint64_t v[])
NOT_SUPPORTED(fmi3SetIntervalDecimal, const Reference a[], size_t n, const double v[])
NOT_SUPPORTED(fmi3SetIntervalFraction, const Reference a[], size_t n, const uint64_t u[], const uint64_t v[])
NOT_SUPPORTED(fmi3SetShiftDecimal, const Reference a[], size_t n, const double v[])
NOT_SUPPORTED(fmi3SetShiftFraction, const Reference a[], size_t n, const uint64_t u[], const uint64_t v[])
NOT_SUPPORTED(fmi3GetOutputDerivatives, const Reference a[], size_t n, const int32_t o[], double v[], size_t m)
NOT_SUPPORTED(fmi3ActivateModelPartition, Reference a, double t)
