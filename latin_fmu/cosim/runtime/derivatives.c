/* Directional derivatives: of outputs at the end of the last step by inputs over it. The kernels make the
   step again from the state before it, on a copy of the run (latin_fmu/kernels/derivatives.py). */
#include "runtime.h"

enum { UNSOLVED = 1, SINGULAR, OWN_LAW };

int room_for_step(struct Object *o)
{
    size_t n_given = 2 * (size_t)o->image->table[T_N_INPUT].i;
    o->made.state = malloc(8 * (size_t)o->image->n_state + 8);
    o->made.given = calloc(n_given + 1, sizeof(double));
    o->made.columns = calloc(n_given + 1, sizeof(double *));
    return o->made.state && o->made.given && o->made.columns;
}

void no_step(struct Object *o)
{
    for (int64_t i = 0; o->made.columns && i < 2 * o->image->table[T_N_INPUT].i; i++) {
        free(o->made.columns[i]);
        o->made.columns[i] = NULL;
    }
    o->made.known = 0;
}

void free_step(struct Object *o)
{
    if (o->image != NULL) no_step(o);
    free(o->made.state);
    free(o->made.given);
    free(o->made.columns);
    o->made = (LastStep){0};
}

/* The step that was just made from the state in o->before. */
void keep_step(struct Object *o, double t, double h, int64_t whole, int64_t ended)
{
    double *state = o->before;
    no_step(o);
    o->before = o->made.state;
    o->made.state = state;
    o->made.t = t;
    o->made.h = h;
    o->made.whole = whole;
    o->made.ended = ended;
    o->made.known = 1;
    memcpy(o->made.given, o->given, 16 * (size_t)o->image->table[T_N_INPUT].i);
}

/* Derivatives of the outputs by value or rate of an input, by the kernels with a record of the run; status of the kernels. */
static int64_t derived(const Instance *c, int64_t which, const char *record, double *column)
{
    struct Object own = *c->fmu; /* with a block and a record of its own, which are changed */
    Instance copy = *c;
    copy.fmu = &own;
    const Word *head = own.image->head;
    size_t n_moving = (size_t)head[M_N_MOVING].i, n_record = (size_t)head[M_RUN_SIZE].i / 8;
    size_t room = (size_t)act(&own, M_DERIVE, -1, 0, 0, 0);
    double *block = aligned(8 * (n_moving + room + n_record));
    if (block == NULL) return NO_MEMORY;
    memcpy(block, own.image->moving, 8 * n_moving);
    memset(block + n_moving, 0, 8 * room);
    memcpy(block, own.made.state, 8 * (size_t)own.image->n_state);
    memcpy(block + n_moving + room, record, 8 * n_record);
    own.moving = block;
    own.given = own.made.given;
    own.slots[0] = (int64_t)(intptr_t)(block + n_moving + room);
    for (int i = 14; i < 18; i += 2) {
        own.slots[i] = (int64_t)(intptr_t)block;
        own.slots[i + 1] = (int64_t)(n_moving + room);
    }
    placed(&copy, own.made.t, own.made.h);
    int64_t rule = (int64_t)parameter(c, T_RULE, CAUSAL), status = STOPPED;
    int64_t begun = (int64_t)block[head[M_PROGRESS].i], size = (int64_t)(n_moving + room);
    if (!notified(&own, ABOUT_TO, begun, own.made.ended, own.made.whole) &&
        !notified(&own, WORKS_ON, (int64_t)(intptr_t)block, size, 0))
        status = act(&own, M_DERIVE, which, rule, own.made.ended, own.made.whole);
    if (notified(&own, WORKS_ON, (int64_t)(intptr_t)c->fmu->moving, (int64_t)n_moving, 0)) status = STOPPED;
    memcpy(column, block + head[M_OUTPUT].i, 8 * (size_t)own.image->n_output);
    aligned_free(block);
    return status;
}

/* The column of an input, which is computed when it is first requested; NULL after a message. */
static const double *column_of(Instance *c, int64_t which)
{
    struct Object *o = c->fmu;
    if (o->made.columns[which] != NULL) return o->made.columns[which];
    double *column = calloc((size_t)o->image->n_output + 1, sizeof *column);
    int64_t status = column == NULL ? NO_MEMORY : 0; /* without time steps outputs are held */
    if (status == 0 && o->made.ended > 0) status = derived(c, which, o->image->records[0], column);
    if (status == UNSOLVED) status = derived(c, which, relaxed_record(o), column);
    if (status == 0) return o->made.columns[which] = column;
    free(column);
    if (status == UNSOLVED)
        msg(c, ERROR, "no directional derivative: the iteration of the last step needed a fall-back");
    else if (status == SINGULAR)
        msg(c, ERROR, "no directional derivative: the interface equations linearised at the present solution are singular");
    else if (status == OWN_LAW)
        msg(c, ERROR, "no directional derivative: an interface has a user-defined law in Python; only laws of the package have "
            "compiled tangents");
    else if (status < BEYOND_LAWS && status > STOPPED) /* numbers below -1 name an input, by whose start value the state at t = 0 is known */
        msg(c, ERROR, "no directional derivative: the state at t = 0 was computed only for the start value of %s: make a second "
            "step", input_name(c, -2 - status, IN_VALUE));
    else
        refused_by_kernels(c, status, o->made.t, ERROR);
    return NULL;
}

static int is_output(Instance *c, uint32_t reference)
{
    const Word *v = variable(c, reference);
    int64_t after = v[V_PLACE].i - c->fmu->image->head[M_OF_EVENT].i;
    const char *own = text_at(c, v[V_NAME].i);
    if (v[V_ROLE].i != OUTPUT) return msg(c, ERROR, "no directional derivative: %s is not an output of this model", own), 0;
    if (after < 0 || after % 2 == 0) return 1;
    return msg(c, ERROR, "no directional derivative: %s is the instant of an event, whose derivative is not available: omit it", own), 0;
}

static int is_rate_of_wave(const char *name)
{
    while (*name && strncmp(name, ".incidentRate", 13) != 0) name++;
    return *name != '\0';
}

static int is_input(Instance *c, uint32_t reference)
{
    const Word *v = variable(c, reference);
    const char *own = text_at(c, v[V_NAME].i);
    if (v[V_ROLE].i != VALUE && v[V_ROLE].i != RATE)
        return msg(c, ERROR, "no directional derivative: %s is not an input of this model", own), 0;
    if (v[V_ROLE].i == VALUE || !is_rate_of_wave(own) || c->fmu->made.given[2 * v[V_PLACE].i + 1] != 0.0) return 1;
    return msg(c, ERROR, "no directional derivative: %s: a wave with rate 0 is interpolated linearly to its value and has no "
               "derivative with respect to the rate", own), 0;
}

int derivable(Instance *c, const uint32_t *unknowns, size_t n, const uint32_t *knowns, size_t m)
{
    if (!known(c, unknowns, n) || !known(c, knowns, m)) return 0;
    if (c->phase < EVENT || parameter(c, T_MODE, 0.0) == PRESCRIBED)
        return msg(c, ERROR, "no directional derivative in prescribed mode, or before initialization"), 0;
    if (!c->fmu->made.known)
        return msg(c, ERROR, "no directional derivative: no step was made since the start, or since a state was restored: make a "
                   "step first"), 0;
    for (size_t i = 0; i < n; i++)
        if (!is_output(c, unknowns[i])) return 0;
    for (size_t i = 0; i < m; i++)
        if (!is_input(c, knowns[i])) return 0;
    return 1;
}

int directional_derivative(Instance *c, const uint32_t *unknowns, size_t n, const uint32_t *knowns, size_t m,
                           const double *seed, size_t size_of_seed, double *values, size_t size)
{
    if (n == 0) return OK;
    if (size_of_seed != m || size != n)
        return msg(c, ERROR, "no directional derivative: the importer passes %zu numbers for %zu inputs and %zu for %zu outputs; only "
                   "scalars have derivatives", size_of_seed, m, size, n);
    if (!derivable(c, unknowns, n, knowns, m)) return ERROR;
    memset(values, 0, n * sizeof *values);
    for (size_t k = 0; k < m; k++) {
        const Word *v = variable(c, knowns[k]);
        const double *column = column_of(c, 2 * v[V_PLACE].i + (v[V_ROLE].i == RATE));
        if (column == NULL) return ERROR;
        for (size_t i = 0; i < n; i++) values[i] += seed[k] * column[variable(c, unknowns[i])[V_PLACE].i];
    }
    return OK;
}
