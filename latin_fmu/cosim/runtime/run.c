/* Life cycle of an instance: initialization, steps. The kernels compute; nothing is factorised here. */
#include "runtime.h"

#include <stdio.h>

#if defined(LATIN_FMU_WITHOUT_KERNELS) /* a process hands them over */
static int32_t (*const kernels_entries_call_0)(const int64_t *, void *) = NULL;
#else
int32_t kernels_entries_call_0(const int64_t *slots, void *result);
#endif

static const double SHORTEST = 1e-9, EARLY = 1e-6; /* of a time step, of a step: see latin_fmu/cosim/settings.py */
static const double MOST_STEPS = 1e6;
static const double EXACT = 1e-9; /* of the largest traction: what a law may miss, as in latin_fmu/latin/instant_solve.py */

int msg(const Instance *c, int status, const char *format, ...)
{
    char text[1500];
    va_list given;
    va_start(given, format);
    vsnprintf(text, sizeof text, format, given);
    va_end(given);
    emit(c, status, text);
    return status;
}

/* -- instances --------------------------------------------------------------------------------------------------------- */
int renewed(Instance *c)
{
    struct Object *o = c->fmu;
    const Image *image = o->image;
    if (image->head != NULL) memcpy(o->moving, image->moving, 8 * (size_t)image->head[M_N_MOVING].i);
    o->accuracy = 0.0;
    o->discarded = o->opened = o->acted = 0;
    o->n_row = o->n_fields = 0;
    no_records(o);
    no_step(o);
    o->start = c->time = 0.0;
    c->last = OK;
    memset(o->now, 0, 8 * (size_t)image->n_output);
    return start_variables(c);
}

/* The arrays of the kernels: records, the fixed block in four views, the moving block in two. */
static void set_slots(struct Object *o)
{
    const Word *head = o->image->head;
    int64_t fixed = head[M_N_FIXED].i, moving = head[M_N_MOVING].i;
    const struct { const void *block; int64_t n; } arrays[] = {
        {o->image->records[0], 1}, {o->image->records[1], head[M_N_CLASS].i}, {o->image->records[2], head[M_N_GROUP].i},
        /* the same memory as numbers of 8 and of 4 bytes, real and whole */
        {o->image->fixed, fixed}, {o->image->fixed, fixed}, {o->image->fixed, 2 * fixed}, {o->image->fixed, 2 * fixed},
        {o->moving, moving}, {o->moving, moving}};
    for (int i = 0; i < 9; i++) {
        o->slots[2 * i] = (int64_t)(intptr_t)arrays[i].block;
        o->slots[2 * i + 1] = arrays[i].n;
    }
}

int take_image(Instance *c, const Image *image)
{
    struct Object *o = c->fmu;
    if (image == NULL) return msg(c, ERROR, "no memory for an instance"), 0;
    free_step(o);
    if (o->image != NULL && o->image->process == NULL) aligned_free(o->moving);
    free(o->before);
    free(o->relaxed);
    free(o->now);
    image_freed(o->image);
    o->image = image;
    o->moving = o->before = NULL;
    o->relaxed = NULL;
    o->now = calloc((size_t)image->n_output + 1, sizeof(double));
    int good = o->now != NULL && room_for_step(o);
    if (good && image->head != NULL) { /* else it is made when a simulation begins */
        o->kernels = image->process ? image->process->kernels : kernels_entries_call_0;
        o->moving = image->process ? image->process->moving : aligned(8 * (size_t)image->head[M_N_MOVING].i);
        o->before = malloc(8 * (size_t)image->n_state + 8);
        o->relaxed = malloc((size_t)image->head[M_RUN_SIZE].i);
        good = o->moving && o->before && o->relaxed;
        if (good) set_slots(o);
    }
    return good || (msg(c, ERROR, "no memory for an instance"), 0);
}

int filled(Instance *c, const Image *image)
{
    c->fmu = image ? calloc(1, sizeof *c->fmu) : NULL;
    if (c->fmu == NULL) return image_freed(image), msg(c, ERROR, "no memory for an instance"), 0;
    if (!take_image(c, image)) return 0;
    return renewed(c) || (msg(c, ERROR, "no memory for an instance"), 0);
}

#if !defined(LATIN_FMU_WITHOUT_KERNELS)
int latin_fmu_fits(void);

#if defined(LATIN_FMU_WIDE)
static const char NEEDED[] = "AVX2 and FMA: on this machine use an FMU exported with --portable or --python";
#else
static const char NEEDED[] = "SSE4.2 and POPCNT: on this machine use an FMU exported with --python";
#endif

/* An instance of the files of an FMU. */
static int filled_from_files(Instance *c, const char *token, const char *resources)
{
    char trouble[1200];
    if (!latin_fmu_fits())
        return msg(c, ERROR, "this FMU needs a processor with %s", NEEDED), 0;
    const Image *image = image_of(resources, token, trouble, sizeof trouble);
    if (image == NULL) return msg(c, ERROR, "%s", trouble), 0;
    return filled(c, image);
}
#elif !defined(LATIN_FMU_MAKES)
static int filled_from_files(Instance *c, const char *token, const char *resources)
{
    return (void)token, (void)resources, msg(c, ERROR, "this library has no kernels"), 0;
}
#endif

Instance *opened(const Instance *given, const char *name, const char *token, const char *resources)
{
    Instance *c = malloc(sizeof *c);
    if (c == NULL) return NULL;
    *c = *given;
    c->name = copied(name ? name : "");
    if (c->name == NULL || resources == NULL)
        msg(c, ERROR, "the importer passes no resource folder");
    else if (c->kind == EXCHANGE_3)
        msg(c, ERROR, "this FMU is for co-simulation only");
    else if (filled_from_files(c, token, resources))
        return c;
    closed(c);
    return NULL;
}

int made_for_now(Instance *c)
{
    struct Object *o = c->fmu;
#if defined(LATIN_FMU_MAKES)
    int64_t n_input = table_of(c)[T_N_INPUT].i, prescribed = parameter(c, T_MODE, 0.0) == PRESCRIBED;
    double *starts = calloc((size_t)n_input + 1, sizeof *starts);
    if (starts == NULL) return msg(c, ERROR, "no memory for an instance");
    for (int64_t i = 0; i < n_input; i++)
        starts[i] = prescribed && o->histories[i].n ? history_at(o->histories + i, 0.0) : o->given[2 * i];
    int status = make_image(c, o->numbers, starts);
    free(starts);
    return status;
#else
    return o->image->head != NULL ? OK : ERROR;
#endif
}

void closed(Instance *c)
{
    if (c == NULL) return;
    struct Object *o = c->fmu;
    if (o != NULL) {
        if (o->image != NULL) free_variables(o);
        free_states(o);
        free_step(o);
        if (o->image == NULL || o->image->process == NULL) aligned_free(o->moving);
#if defined(LATIN_FMU_MAKES)
        free_maker(o); /* which keeps the image */
#endif
        free(o->before);
        free(o->relaxed);
        free(o->now);
        free(o->numbers);
        free(o->given);
        free(o->rows);
        free(o->times);
        free(o->fields);
        free(o->records.rows);
        image_freed(o->image);
        free(o);
    }
    free(c->name);
    free(c);
}

int reset(Instance *c) { return renewed(c) ? OK : msg(c, ERROR, "no memory for an instance"); }

/* -- kernels ----------------------------------------------------------------------------------------------------------- */
int64_t act(struct Object *o, int action, int64_t n, int64_t rule, int64_t made, int64_t whole)
{
    /* behind the addresses and lengths of nine arrays */
    int64_t result = 0, *last = o->slots + 18, given[] = {o->image->head[action].i, n, rule, made, whole};
    memcpy(last, given, sizeof given);
    return o->kernels(o->slots, &result) ? NO_MEMORY : result;
}

int notified(const struct Object *o, int64_t what, int64_t a, int64_t b, int64_t c)
{
    const Process *process = o->image->process;
    if (process == NULL || process->notify == NULL) return 0;
    *process->answered = 0;
    int64_t stops = process->notify(what, a, b, c);
    return stops != 0 || *process->answered == 0;
}

/* Makes n time steps, behind ``made`` of the whole ones of a communication step; how many, or a negative result. The process
   is notified where it wants to be, where the tables of the laws of the scene end, and between the calls of a long step, which it
   may stop. */
static int64_t communicated(struct Object *o, int64_t n, int64_t rule, int64_t made, int64_t whole)
{
    const Process *process = o->image->process;
    int64_t always = process != NULL && process->always, last = o->image->head[M_LAST_STEP].i;
    int64_t progress = (int64_t)o->moving[o->image->head[M_PROGRESS].i];
    if ((always || (last >= 0 && progress + n > last)) && notified(o, ABOUT_TO, progress, n, whole)) return STOPPED;
    int64_t result = act(o, M_COMMUNICATE, n, rule, made, whole);
    return (always || made + n < whole) && notified(o, HAVE_MADE, made, result, whole) ? STOPPED : result;
}

/* A record of the run whose iteration has no differences, and a relaxation of 1/2; of the record as it is now. */
const char *relaxed_record(struct Object *o)
{
    const Word *head = o->image->head;
    int64_t depth = 0;
    double relaxation = 0.5;
    memcpy(o->relaxed, o->image->records[0], (size_t)head[M_RUN_SIZE].i);
    memcpy(o->relaxed + head[M_DEPTH_AT].i, &depth, sizeof depth);
    memcpy(o->relaxed + head[M_RELAXATION_AT].i, &relaxation, sizeof relaxation);
    return o->relaxed;
}

/* A time step by a new iteration with relaxation 1/2, where the acceleration has stalled: it passes most stalls. */
static int64_t relaxed(struct Object *o, int64_t rule, int64_t made, int64_t whole)
{
    int64_t kept = o->slots[0];
    o->slots[0] = (int64_t)(intptr_t)relaxed_record(o);
    int64_t result = communicated(o, 1, rule, made, whole);
    o->slots[0] = kept;
    return result;
}

/* What the host has set of the laws of the interfaces, at each of their points. */
static void give_tunables(struct Object *o)
{
    const Word *table = o->image->run_table, *v = table + table[T_VARIABLES].i;
    for (int64_t r = 0; r < table[T_N_VARIABLE].i; r++, v += V_ROW)
        if (v[V_ROLE].i == TUNABLE)
            for (int64_t p = 0; p < v[V_WIDTH].i; p++) o->moving[v[V_PLACE].i + p * v[V_DIMENSION].i] = o->numbers[r];
}

static void give_inputs(struct Object *o)
{
    for (int64_t i = 0; i < o->image->table[T_N_INPUT].i; i++) {
        o->moving[o->image->head[M_VALUE].i + i] = o->given[2 * i];
        o->moving[o->image->head[M_RATE].i + i] = o->given[2 * i + 1];
        if (o->given[2 * i] != 0.0 || o->given[2 * i + 1] != 0.0) o->acted = 1;
    }
    give_tunables(o);
}

int refused_by_kernels(const Instance *c, int64_t result, double t, int status)
{
    const Image *image = c->fmu->image;
    if (result == NO_MEMORY) return msg(c, ERROR, "no memory for the work arrays of the step at %g s", t);
    if (result == STOPPED) return msg(c, ERROR, "stopped in the step at %g s: %s", t, image->process->trouble);
    if (result == BEYOND_LAWS)
        return msg(c, ERROR, "the step exceeds the tabulated time laws of the scene, which end %g s after the start: export "
                   "an FMU of a scene with a later time.end", (double)image->head[M_LAST_STEP].i * image->dt);
    if (result < BEYOND_LAWS) {
        /* numbers below -1 name an input */
        int64_t input = -2 - result, reference = image->table[image->table[T_INPUTS].i + IN_ROW * input + IN_REFERENCE].i;
        double start = variable(c, reference)[V_START].d;
        if (c->fmu->given[2 * input] != start)
            return msg(c, ERROR, "%s must be %g at the start, the value for which the initial state was computed: export an "
                       "FMU of a scene with another start_value", input_name(c, input, IN_VALUE), start);
        return msg(c, ERROR, "%s must remain %g over the first time step, the value of the initial state: change it later, "
                   "or use an FMU exported with --python", input_name(c, input, IN_VALUE), start);
    }
    return msg(c, status, "no convergence of the time step that ends at %g s%s", t,
               status == DISCARD ? ": use smaller communication steps, or smaller changes of the inputs" : "");
}

/* -- outputs of the last step ------------------------------------------------------------------------------------------ */
static int keeps_all(const Image *image) { return image->process != NULL && image->process->whole; }

int has_arrays(const Instance *c) { return keeps_all(c->fmu->image) || table_of(c)[T_WINDOW_SIZE].i >= 0; }

/* A process reads the fields of a whole step; the arrays of an FMU are those at its end. */
int64_t rows_with_fields(const Instance *c, int64_t n_row)
{
    return n_row == 0 || !has_arrays(c) ? 0 : keeps_all(c->fmu->image) ? n_row : 1;
}

int64_t size_of_fields(const Instance *c) { return c->fmu->image->head ? c->fmu->image->head[M_N_FIELD].i : 0; }

int room_for(struct Object *o, int64_t n_row, int64_t n_fields, int64_t size)
{
    double *rows = realloc(o->rows, 8 * (size_t)(n_row * o->image->n_output + 1));
    if (rows != NULL) o->rows = rows;
    double *times = realloc(o->times, 8 * (size_t)(n_row + 1));
    if (times != NULL) o->times = times;
    double *fields = realloc(o->fields, 8 * (size_t)(n_fields * size + 1));
    if (fields != NULL) o->fields = fields;
    return rows && times && fields;
}

/* Keeps outputs of a row of the kernels, which is an instant since the start, and fields where asked for. */
static void keep(const Instance *c, int64_t from, int64_t row, int64_t instant, int64_t field_row)
{
    struct Object *o = c->fmu;
    const Image *image = o->image;
    const double *outputs = o->moving + image->head[M_OUTPUT].i + from * image->n_output;
    const double *fields = o->moving + image->head[M_FIELD].i;
    if (row >= 0) {
        memcpy(o->rows + row * image->n_output, outputs, 8 * (size_t)image->n_output);
        o->times[row] = (double)instant * image->dt;
    }
    int recorded = keeps_results(c) && (from > 0 || !has_record(c, instant)); /* row 0 is the end of the step before */
    if (field_row < 0 && !recorded) return;
    act(o, M_FIELDS, from, 0, 0, 0);
    if (field_row >= 0) memcpy(o->fields + field_row * size_of_fields(c), fields, 8 * (size_t)size_of_fields(c));
    if (recorded) keep_record(c, instant, outputs, fields);
}

/* -- initialization ---------------------------------------------------------------------------------------------------- */
int setup(Instance *c, double start, double tolerance)
{
    double own = parameter(c, T_TOLERANCE, 0.0);
    c->time = c->fmu->start = start;
    c->fmu->accuracy = tolerance;
    if (c->fmu->maker == NULL && tolerance > 0.0 && fabs(0.2 * tolerance - own) > 1e-9 * own)
        msg(c, WARNING, "the tolerance %g of the importer has no effect: that of a compiled FMU is fixed at export "
            "(%g on sqrt(eta), a relative accuracy of %g)", tolerance, own, 5.0 * own);
    return OK;
}

static int in_range(const Instance *c, int header, const char *what, double most, const char *allowed)
{
    double value = parameter(c, header, 0.0);
    if (value >= 0.0 && value <= most) return 1;
    msg(c, ERROR, "%s: unknown value %g (allowed: %s)", what, value, allowed);
    return 0;
}

int can_start(const Instance *c)
{
    const struct Object *o = c->fmu;
    int bad = not_finite(c);
    if (bad)
        msg(c, ERROR, "%s = %g: is not a finite number", input_name(c, (bad - 1) / 2, bad % 2 ? IN_VALUE : IN_RATE),
            o->given[bad - 1]);
    else if (!isfinite(o->start))
        msg(c, ERROR, "the start time %g s is not a finite number", o->start);
    else
        return in_range(c, T_MODE, "mode", 1.0, "0 (windowed) or 1 (prescribed)") &&
               in_range(c, T_RULE, "inputInterpolation", 3.0, "0 (hold), 1 (rate), 2 (line), 3 (causal line)");
    return 0;
}

/* Inputs of a time step of prescribed mode, of n: their values at its end, and their rates over the next one, which give
   a displacement its velocity there; after the last one as over it. */
static void set_step(Instance *c, int64_t step, int64_t n)
{
    struct Object *o = c->fmu;
    double dt = o->image->dt, *value = o->moving + o->image->head[M_VALUE].i, *rate = o->moving + o->image->head[M_RATE].i;
    double first = (double)(step < n ? step : step - 1) * dt;
    for (int64_t i = 0; i < table_of(c)[T_N_INPUT].i; i++) {
        const History *h = o->histories + i;
        if (h->n == 0) continue;
        value[i] = history_at(h, (double)step * dt);
        rate[i] = (history_at(h, first + dt) - history_at(h, first)) / dt;
        if (value[i] != 0.0) o->acted = 1;
    }
}

/* Whether every point of a rigid body that is pressed at the start stays so, and does not slide: else its tractions are no
   linear function of the inputs. */
static int stands(const Instance *c)
{
    const Word *table = c->fmu->image->run_table, *points = table + table[T_PRESSED].i;
    int64_t n = table[T_N_PRESSED].i;
    double largest = 0.0;
    for (int64_t i = 0; i < P_ROW * n; i += P_ROW)
        for (int64_t k = 0; k < points[i + P_SIZE].i; k++)
            largest = fmax(largest, fabs(c->fmu->moving[points[i + P_PLACE].i + k]));
    for (int64_t i = 0; i < P_ROW * n; i += P_ROW) {
        const double *f = c->fmu->moving + points[i + P_PLACE].i;
        double shear = points[i + P_SIZE].i > 1 ? hypot(f[1], f[2]) : 0.0, friction = points[i + P_FRICTION].d;
        if (points[i + P_TUNED].i >= 0) friction = c->fmu->moving[points[i + P_TUNED].i];
        if (-f[0] >= -EXACT * largest && shear <= -friction * f[0] + EXACT * largest) continue;
        msg(c, ERROR, "inputs or friction make a rigid body slide or lift off immediately at interface %s, for which the initial state "
            "was not computed: start with smaller inputs, or use an FMU exported with --python",
            (const char *)(table + table[T_TEXTS].i) + points[i + P_NAME].i);
        return 0;
    }
    return 1;
}

/* Outputs at the start, under the inputs that the kernels were given, which go on by a rule; n: time steps of a whole
   history, or 0. */
static int present(Instance *c, int64_t rule, int64_t n)
{
    struct Object *o = c->fmu;
    int64_t n_field = has_arrays(c) ? 1 : 0;
    o->moving[o->image->head[M_PROGRESS].i + 6] = o->start;
    int64_t result = act(o, M_PRESENT, 0, 0, 0, 0); /* the simulation begins ... */
    if (n > 0) set_step(c, 1, n);
    if (result >= 0) result = act(o, M_PRESENT, rule, 1, 0, 0); /* ... as with a first step of one time step */
    if (result < 0) return refused_by_kernels(c, result, o->start, ERROR);
    if (!stands(c)) return ERROR;
    if (!room_for(o, 1, n_field, size_of_fields(c))) return msg(c, ERROR, "no memory for the outputs");
    no_records(o);
    keep(c, 0, 0, 0, n_field - 1);
    o->n_row = 1;
    o->n_fields = n_field;
    memcpy(o->now, o->rows, 8 * (size_t)o->image->n_output);
    return OK;
}

static void sums_over_rows(Instance *c)
{
    struct Object *o = c->fmu;
    int64_t at = table_of(c)[T_SOLVER].i, width = o->image->n_output;
    double iterations = 0.0, worst = 0.0;
    for (int64_t i = 1; i < o->n_row; i++) {
        iterations += o->rows[i * width + at];
        worst = fmax(worst, o->rows[i * width + at + 1]);
    }
    for (int64_t i = 0; i < o->n_row; i++) {
        const double whole[] = {iterations, worst, 1.0, (double)o->n_row - 1.0};
        memcpy(o->rows + i * width + at, whole, sizeof whole);
    }
}

/* Prescribed mode: the whole interval, one instant after the other. */
int solve_histories(Instance *c)
{
    struct Object *o = c->fmu;
    int64_t n_input = table_of(c)[T_N_INPUT].i, arrays = has_arrays(c);
    double end = parameter(c, T_END, 0.0), dt = o->image->dt, *value = o->moving + o->image->head[M_VALUE].i;
    double whole = rint(end / dt);
    if (!(whole >= 1.0 && whole <= MOST_STEPS && fabs(end - whole * dt) <= 1e-9 * end))  /* not for NaN */
        return msg(c, ERROR, "endTime = %g s is not an integer number of time steps of %g s from 1 to %g", end, dt, MOST_STEPS);
    int64_t n = (int64_t)whole;
    /* nothing of an earlier solution stays: the state at the start is that of the image */
    memcpy(o->moving, o->image->moving, 8 * (size_t)o->image->head[M_N_MOVING].i);
    for (int64_t i = 0; i < n_input; i++) {
        const History *h = o->histories + i;
        value[i] = h->n ? history_at(h, 0.0) : o->first[2 * i];
        if (value[i] != 0.0) o->acted = 1;
        o->moving[o->image->head[M_RATE].i + i] = 0.0;
    }
    give_tunables(o);
    int status = present(c, PATH, n);
    if (status == OK && !room_for(o, n + 1, arrays * (n + 1), size_of_fields(c)))
        status = msg(c, ERROR, "no memory for the outputs of %lld time steps", (long long)n);
    for (int64_t step = 1; step <= n && status == OK; step++) {
        set_step(c, step, n);
        int64_t made = communicated(o, 1, PATH, 0, 1);
        if (made == 0) made = relaxed(o, PATH, 0, 1);
        if (made != 1) {
            status = refused_by_kernels(c, made, o->start + (double)step * dt, ERROR);
            continue;
        }
        if (step == 1) { /* the acceleration at the start is known with the velocity at the next instant */
            no_records(o);
            keep(c, 0, 0, 0, arrays - 1);
        }
        keep(c, 1, step, step, arrays ? step : -1);
    }
    if (status != OK) return status;
    o->n_row = n + 1;
    o->n_fields = arrays * (n + 1);
    sums_over_rows(c);
    memcpy(o->now, o->rows, 8 * (size_t)o->image->n_output);
    return OK;
}

int initialize(Instance *c)
{
    struct Object *o = c->fmu;
    if (o->opened) return OK;
    if (!can_start(c)) return ERROR;
    int status = set_histories(c);
    if (status == OK && keeps_results(c)) status = results_ready(c);
    if (status == OK) status = made_for_now(c);
    if (status != OK) return status;
    memcpy(o->first, o->given, 16 * (size_t)table_of(c)[T_N_INPUT].i);
    c->time = o->start;
    memcpy(o->moving, o->image->moving, 8 * (size_t)o->image->head[M_N_MOVING].i); /* whatever a failure left */
    give_inputs(o);
    status = parameter(c, T_MODE, 0.0) == PRESCRIBED ? solve_histories(c)
                                                       : present(c, (int64_t)parameter(c, T_RULE, CAUSAL), 0);
    o->opened = status == OK;
    /* Python has said so of the scene */
    if (o->opened && o->maker == NULL && table_of(c)[T_UNLOADED].i && table_of(c)[T_N_INPUT].i == 0)
        msg(c, WARNING, "nothing loads or moves a body in this FMU, and it has no inputs: every result is zero; export a "
            "scene with a load, an initial velocity or a driven boundary");
    return status;
}

int terminate(Instance *c)
{
    if (table_of(c)[T_UNLOADED].i && table_of(c)[T_N_INPUT].i && !c->fmu->acted && c->time > c->fmu->start)
        msg(c, WARNING, "no load was applied: all inputs remained 0, and nothing else loads or moves a body in this FMU; set %s", input_name(c, 0, IN_VALUE));
    if (keeps_results(c) && write_results(c) != OK) return ERROR;
    if (c->fmu->discarded) return msg(c, ERROR, "the simulation ends at %g s: the step from there was discarded", c->time);
    return OK;
}

/* -- steps ------------------------------------------------------------------------------------------------------------- */
static int discarded(Instance *c, int status, double t, double h)
{
    struct Object *o = c->fmu;
    o->refused[0] = t;
    o->refused[1] = h;
    memcpy(o->refused + 2, o->given, 16 * (size_t)table_of(c)[T_N_INPUT].i);
    o->discarded = 1;
    return status;
}

static int same_again(const Instance *c, double t, double h)
{
    const struct Object *o = c->fmu;
    return o->discarded && o->refused[0] == t && o->refused[1] == h &&
           memcmp(o->refused + 2, o->given, 16 * (size_t)table_of(c)[T_N_INPUT].i) == 0;
}

/* First row of outputs whose counts of contact events are not those of the row before; 0 where there is none. */
static int64_t first_event(const Image *image, const double *rows, int64_t n_row)
{
    int64_t n = image->n_output;
    for (int64_t row = 1; row < n_row; row++)
        for (int64_t i = image->head[M_OF_EVENT].i; i + 1 < n; i += 2)
            if (rows[row * n + i] != rows[(row - 1) * n + i]) return row;
    return 0;
}

/* Row of the last instant not beyond a time since the start. */
static int64_t row_at(const struct Object *o, double time)
{
    double place = time / o->image->dt;
    /* an instant that is reached but for round-off is reached */
    int64_t row = (int64_t)floor(place + 1e-9 * fmax(1.0, fabs(place)));
    return row < o->n_row ? row : o->n_row - 1;
}

int64_t row_now(const Instance *c)
{
    const struct Object *o = c->fmu;
    return parameter(c, T_MODE, 0.0) == PRESCRIBED ? row_at(o, c->time - o->start) : o->n_row - 1;
}

/* Plays the solution of prescribed mode back: outputs at an instant, linear between two. */
static int played_back(Instance *c, double t, double h)
{
    struct Object *o = c->fmu;
    int64_t n_input = table_of(c)[T_N_INPUT].i, width = o->image->n_output;
    double end = o->times[o->n_row - 1], time = t + h - o->start, dt = o->image->dt;
    for (int64_t i = 0; i < 2 * n_input; i++)
        if (o->given[i] != o->first[i])
            return msg(c, DISCARD, "%s was changed after initialization, which has no effect in prescribed mode: give a "
                       "history before initialization, or use mode 0 (windowed)", input_name(c, i / 2, IN_VALUE));
    if (time > end * (1.0 + 1e-9))
        return msg(c, DISCARD, "the solved interval ends at %g s: set endTime before initialization", o->start + end);
    if (c->early) {
        int64_t first = row_at(o, t - o->start), event = first_event(o->image, o->rows + first * width, row_at(o, time) - first + 1);
        if (event > 0 && o->times[first + event] < time - 1e-9 * h) time = o->times[first + event];
    }
    o->ended = o->n_row - 1;
    c->time = time == t + h - o->start ? t + h : o->start + time;
    double place = time / dt, near = rint(place);
    /* an instant itself, without interpolation */
    if (fabs(place - near) <= 1e-9 * fmax(1.0, fabs(place))) place = near;
    place = fmin(fmax(place, 0.0), (double)(o->n_row - 1));
    /* the last instant belongs to the last interval */
    int64_t low = (int64_t)place < o->n_row - 1 ? (int64_t)place : o->n_row - 2;
    double share = place - (double)low;
    const double *a = o->rows + low * width, *b = a + width;
    /* a weight of 0 or 1 would leave rows as they are, but for numbers that are not finite */
    for (int64_t i = 0; i < width; i++)
        o->now[i] = share == 0.0 ? a[i] : share == 1.0 ? b[i] : (1.0 - share) * a[i] + share * b[i];
    for (int64_t i = o->image->head[M_OF_EVENT].i; i + 1 < width; i += 2) { /* an event is there from its instant on */
        const double *there = b[i + 1] - o->start <= time ? b : a;
        o->now[i] = there[i];
        o->now[i + 1] = there[i + 1];
    }
    return OK;
}

/* The last of the rows alone, where a communication step ends before the next instant. */
static void hold_last(struct Object *o)
{
    size_t width = (size_t)o->image->n_output, last = (size_t)o->n_row - 1;  /* the two may be one */
    size_t size = (size_t)o->image->head[M_N_FIELD].i;
    memmove(o->rows, o->rows + last * width, 8 * width);
    o->times[0] = o->times[last];
    if (o->n_fields > 1) memmove(o->fields, o->fields + ((size_t)o->n_fields - 1) * size, 8 * size);
    if (o->n_fields > 1) o->n_fields = 1;
    o->n_row = 1;
}

/* The time steps of a communication step: whole, those that are made, rows kept of them. */
typedef struct {
    int64_t whole, end, kept;
} Part;

/* Rows of a part that are not kept: the first ones, where there are too many. */
static int64_t n_skipped(Part part) { return part.end + 1 - part.kept; }

/* Makes the time steps of a part into new rows; how many, and the last result of the kernels. event: where not NULL, the
   time step that the first contact event is in; the march ends behind it. */
static int64_t march(const Instance *c, Part part, int64_t *result, int64_t *event)
{
    struct Object *o = c->fmu;
    const Image *image = o->image;
    int64_t most = image->head[M_MOST_STEPS].i, rule = (int64_t)parameter(c, T_RULE, CAUSAL);
    int64_t skipped = n_skipped(part), without = part.kept - rows_with_fields(c, part.kept);
    int64_t before = (int64_t)o->moving[image->head[M_PROGRESS].i], n = part.end, made = 0, stalled = 0;
    while (made < n) {
        int64_t some = n - made < most ? n - made : most;
        int64_t done = stalled ? relaxed(o, rule, made, part.whole) : communicated(o, some, rule, made, part.whole);
        *result = done;
        if (done < 0 || (stalled && done == 0)) break;
        stalled = !stalled && done < some;
        for (int64_t i = made == 0 ? 0 : 1; i <= done; i++) {
            int64_t row = made + i - skipped;
            keep(c, i, row, before + made + i, row - without);
        }
        int64_t row = event ? first_event(image, o->moving + image->head[M_OUTPUT].i, done + 1) : 0;
        made += done;
        if (row > 0) {
            *event = made - done + row;
            break;
        }
    }
    return made;
}

/* Gives inputs and place of a communication step to the kernels; its time steps. */
int64_t placed(Instance *c, double t, double h)
{
    struct Object *o = c->fmu;
    double *place = o->moving + o->image->head[M_PLACE].i, dt = o->image->dt;
    give_inputs(o);
    place[0] = (t + h - o->start) / dt;
    place[1] = h / dt;
    place[2] = 4e-16 * (fabs(t) + fabs(t + h)) / dt;  /* round-off of the times of the host, in steps */
    return act(o, M_PLACING, 0, 0, 0, 0);
}

/* Solves the time steps that end in a communication step, or up to the first contact event where the host lets it end
   early; nothing changes where one of them fails. */
static int marched(Instance *c, double t, double h)
{
    struct Object *o = c->fmu;
    const Image *image = o->image;
    memcpy(o->before, o->moving, 8 * (size_t)image->n_state);
    int64_t n = placed(c, t, h), rule = (int64_t)parameter(c, T_RULE, CAUSAL);
    if (n == 0) {
        act(o, M_COMMUNICATE, 0, rule, 0, 0);
        keep_step(o, t, h, 0, 0);
        o->ended = 0;
        c->time = t + h;
        return hold_last(o), OK;
    }
    int64_t wanted = keeps_all(image) ? n + 1 : has_arrays(c) ? (int64_t)parameter(c, T_WINDOW_SIZE, 1.0) : 1;
    Part part = {n, n, n + 1 < wanted ? n + 1 : wanted};
    double *rows = o->rows, *times = o->times, *fields = o->fields;
    /* the old rows are kept until the step is accepted */
    o->rows = o->times = o->fields = NULL;
    int64_t result = NO_MEMORY, begun = (int64_t)o->moving[image->head[M_PROGRESS].i], event = n;
    int good = room_for(o, part.kept, rows_with_fields(c, part.kept), size_of_fields(c));
    int64_t made = good ? march(c, part, &result, c->early ? &event : NULL) : 0;
    if (event < n) { /* again, up to there */
        memcpy(o->moving, o->before, 8 * (size_t)image->n_state);
        placed(c, t, h);
        part = (Part){n, event, event + 1 < wanted ? event + 1 : wanted};
        made = march(c, part, &result, NULL);
        if (made == event) act(o, M_COMMUNICATE, 0, rule, event, n);
    }
    int whole = good && made == part.end;
    /* the kernels do not put back all that the fields of their first row follow from: it is the end of the step before */
    if (whole && begun > 0 && o->n_fields > 0 && rows_with_fields(c, part.kept) == part.end + 1)
        memcpy(o->fields, fields + (o->n_fields - 1) * size_of_fields(c), 8 * (size_t)size_of_fields(c));
    double *unused[] = {whole ? rows : o->rows, whole ? times : o->times, whole ? fields : o->fields};
    for (int i = 0; i < 3; i++) free(unused[i]);
    if (whole) {
        keep_step(o, t, h, n, event);
        o->ended = event;
        o->n_row = part.kept;
        o->n_fields = rows_with_fields(c, part.kept);
        memcpy(o->now, o->rows + (part.kept - 1) * image->n_output, 8 * (size_t)image->n_output);
        c->time = event < n ? o->start + (double)(begun + event) * image->dt : t + h;
        return OK;
    }
    o->rows = rows;
    o->times = times;
    o->fields = fields;
    memcpy(o->moving, o->before, 8 * (size_t)image->n_state);
    if (!good) return msg(c, ERROR, "no memory for the outputs of %lld time steps", (long long)n);
    return refused_by_kernels(c, result, o->start + (double)(begun + made + 1) * image->dt, DISCARD);
}

static int advanced(Instance *c, double t, double h)
{
    struct Object *o = c->fmu;
    double dt = o->image->dt;
    if (!isfinite(t) || !isfinite(h)) return msg(c, ERROR, "time %g or step size %g is not a finite number", t, h);
    if (h <= 0.0) return msg(c, ERROR, "the step size %g s must be greater than 0", h);
    /* hosts add up steps: the time they give is off by round-off */
    if (fabs(t - c->time) > fmax(EARLY * h, SHORTEST * dt))
        return msg(c, ERROR, "the step starts at %.17g s, but the present time is %.17g s: restore a state to go back%s", t,
                   c->time, o->discarded ? "; the previous step was discarded: repeat it with a shorter step or another input" : "");
    if (h <= SHORTEST * dt || t + h <= t) { /* below the last digit of t late in a simulation */
        c->time = t + h;                    /* the clock alone */
        o->ended = -1;
        return OK;
    }
    int bad = not_finite(c);
    if (bad)
        return msg(c, DISCARD, "%s = %g is not a finite number", input_name(c, (bad - 1) / 2, bad % 2 ? IN_VALUE : IN_RATE),
                   o->given[bad - 1]);
    if (parameter(c, T_MODE, 0.0) == PRESCRIBED) return played_back(c, t, h);
    if (h / dt > MOST_STEPS)
        return msg(c, DISCARD, "a step of %g s would need %.0f time steps, at most %g are allowed: use shorter steps", h, h / dt,
                   MOST_STEPS);
    return marched(c, t, h);
}

int step(Instance *c, double t, double h)
{
    struct Object *o = c->fmu;
    c->last = ERROR;
    if (same_again(c, t, h)) /* some hosts repeat it for ever */
        return msg(c, ERROR, "the same step was already discarded: repeat it with a shorter step or another input");
    c->last = advanced(c, t, h);
    if (c->last != OK) return discarded(c, c->last, t, h);
    o->discarded = 0;
    memset(o->refused, 0, 8 * (size_t)(2 + 2 * table_of(c)[T_N_INPUT].i)); /* equal runs have equal states */
    return OK;
}

/* A step of a process that made the image itself: one communication step from t to t + h, s; with early up to the end of the time step with the first contact event. Writes
   where it ended and its time steps (-1: it moved the clock alone) into end, and the outputs there. */
EXPORT int latin_fmu_step(Instance *c, double t, double h, int early, const double *given, double *end, double *outputs)
{
    struct Object *o = c->fmu;
    size_t n_input = (size_t)table_of(c)[T_N_INPUT].i;
    double *before = o->refused + 2; /* nothing else is kept there: a refused step leaves no mark here */
    memcpy(before, o->given, 16 * n_input);
    memcpy(o->given, given, 16 * n_input);
    c->early = early;
    int status = advanced(c, t, h);
    if (status != OK) memcpy(o->given, before, 16 * n_input);
    memset(before, 0, 16 * n_input); /* equal runs have equal states */
    end[0] = c->time;
    end[1] = (double)o->ended;
    memcpy(outputs, o->now, 8 * (size_t)o->image->n_output);
    return status;
}

/* -- functions that co-simulation does not have -------------------------------------------------------------------- */
int set_time(Instance *c, double t) { return (void)t, unsupported(c, "fmi3SetTime"); }

int read_vector(Instance *c, const char *method, double *values, size_t size)
{
    return (void)values, (void)size, unsupported(c, method);
}

int write_vector(Instance *c, const char *method, const double *values, size_t size)
{
    return (void)values, (void)size, unsupported(c, method);
}
