/* An instance for a process that has made the image itself, and steps it without the FMI between: the session in Python
   (latin_fmu/cosim/engine.py). A step that is refused changes nothing, and may be tried again. */
#include "runtime.h"

typedef void Told(int status, const char *text); /* takes the messages */

/* What there is to be read: addresses hold until the next call. */
typedef struct {
    int64_t phase, row, n_row, n_fields, size_of_fields;
    double time, start;
    const double *given, *first, *now, *times, *fields;
    const History *histories;
} View;

static void emit_to_process(const Instance *c, int status, const char *category, const char *text)
{
    (void)category;
    ((Told *)c->logger)(status, text);
}

/* The process keeps what it hands over until the instance is freed (fmi3FreeInstance). NULL after a message. */
EXPORT Instance *latin_fmu_open(const Process *process, Told *logger)
{
    Instance *c = calloc(1, sizeof *c);
    if (c == NULL) return NULL;
    c->emit = emit_to_process;
    c->logger = (void *)logger;
    c->kind = COSIMULATION_3;
    c->name = copied("session");
    if (c->name != NULL && fits(process->table, (size_t)process->n_table)) {
        if (filled(c, image_in_memory(process, NULL))) return c;
    } else
        msg(c, ERROR, "the table of variables is damaged");
    closed(c);
    return NULL;
}

EXPORT void latin_fmu_view(const Instance *c, View *view)
{
    const struct Object *o = c->fmu;
    *view = (View){c->phase, row_now(c), o->n_row, o->n_fields, size_of_fields(c), c->time, o->start, o->given, o->first, o->now,
                   o->times, o->fields, o->histories};
}

/* Back to before initialization: no histories, no outputs. */
EXPORT int latin_fmu_renew(Instance *c)
{
    c->phase = INSTANTIATED;
    return renewed(c) ? OK : msg(c, ERROR, "no memory for an instance");
}

EXPORT int latin_fmu_history(Instance *c, int64_t input, int64_t n, const double *t, const double *values)
{
    int status = keep_history(c, input, n, t, values, "history");
    if (status == OK) c->fmu->histories[input].from_process = 1;
    return status;
}

static void give(Instance *c, const double *given)
{
    memcpy(c->fmu->given, given, 16 * (size_t)table_of(c)[T_N_INPUT].i);
}

/* Value and rate of each input, for the state. */
EXPORT void latin_fmu_give(Instance *c, const double *given) { give(c, given); }

/* Discard where what is set cannot be. */
EXPORT int latin_fmu_initialize(Instance *c, double start, const double *given, double *outputs)
{
    struct Object *o = c->fmu;
    give(c, given);
    c->time = o->start = start;
    c->phase = FAILED; /* stays where the next lines fail */
    if (!can_start(c)) return DISCARD;
    int status = initialize(c);
    if (status == OK) c->phase = STEP;
    memcpy(outputs, o->now, 8 * (size_t)o->image->n_output);
    return status;
}

/* As directional_derivative of instance.h; Discard where there is none of these variables at all. */
EXPORT int latin_fmu_derivative(Instance *c, const uint32_t *unknowns, int64_t n, const uint32_t *knowns, int64_t m,
                                const double *seed, double *values)
{
    size_t n_unknown = (size_t)n, n_known = (size_t)m;
    if (!derivable(c, unknowns, n_unknown, knowns, n_known)) return DISCARD;
    return directional_derivative(c, unknowns, n_unknown, knowns, n_known, seed, n_known, values, n_unknown);
}
