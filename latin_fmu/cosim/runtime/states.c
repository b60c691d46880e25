/* States: one block of words, the same in memory and serialized but for the checksum.

   Header, lengths, then the data of these lengths. A state that comes from outside is checked when it is read: a damaged
   one, one of another FMU or with numbers that cannot be is refused. The solution of prescribed mode is not in it: it
   follows from the histories, and is computed anew where they are others than now. */
#include "runtime.h"

enum { S_MAGIC, S_CHECKSUM, S_N_WORD, S_TABLE, S_PHASE, S_DISCARDED, S_N_ROW, S_N_FIELDS, S_N_ARRAY, S_START, S_TIME,
       S_RECORD, S_N_STATE, S_ACCURACY, S_HEADER };
static const char magic[] = "LATINST2";

/* Where the words are, how many have gone by, and what is done with them. */
typedef struct {
    Word *words;
    size_t n;
    enum { COUNTING, WRITING, READING } how;
} Pack;

static void pass(Pack *p, void *memory, size_t n_word)
{
    if (p->how == WRITING && n_word > 0) memcpy(p->words + p->n, memory, 8 * n_word);
    if (p->how == READING && n_word > 0) memcpy(memory, p->words + p->n, 8 * n_word);
    p->n += n_word;
}

static int is_prescribed(const Instance *c) { return parameter(c, T_MODE, 0.0) == PRESCRIBED; }

/* -- lengths ----------------------------------------------------------------------------------------------------------- */
/* Header, bytes of each text, points of each history, whether each array was given. */
static void pass_lengths(const Instance *c, Pack *p, Word *head, int64_t *lengths)
{
    int64_t n_length = table_of(c)[T_N_VARIABLE].i + 2 * table_of(c)[T_N_INPUT].i + 1;
    pass(p, head, S_HEADER);
    pass(p, lengths, (size_t)n_length);
}

static void own_lengths(const Instance *c, Word *head, int64_t *lengths)
{
    const struct Object *o = c->fmu;
    int64_t n_input = table_of(c)[T_N_INPUT].i, kept = !is_prescribed(c);
    memset(head, 0, S_HEADER * sizeof *head);
    memcpy(head, magic, 8);
    head[S_TABLE].u = table_of(c)[T_CHECKSUM].u;
    head[S_PHASE].i = c->phase;
    head[S_DISCARDED].i = o->discarded;
    head[S_N_ROW].i = kept * o->n_row;
    head[S_N_FIELDS].i = kept * o->n_fields;
    head[S_N_ARRAY].i = o->n_array;
    head[S_START].d = o->start;
    head[S_TIME].d = c->time;
    head[S_RECORD].u = record_now(c);
    head[S_N_STATE].i = c->phase >= EVENT ? o->image->n_state : 0; /* before, it follows from what is set */
    head[S_ACCURACY].d = o->accuracy;
    for (int64_t r = 0; r < table_of(c)[T_N_VARIABLE].i; r++) *lengths++ = o->texts[r] ? (int64_t)strlen(o->texts[r]) : 0;
    for (int64_t i = 0; i < n_input; i++) *lengths++ = o->histories[i].n;
    for (int64_t i = 0; i <= n_input; i++) *lengths++ = o->arrays[i] != NULL;
}

/* -- data -------------------------------------------------------------------------------------------------------------- */
/* The numbers whose count is that of the FMU, then those of the lengths; o may be another object than that of c. */
static void pass_data(const Instance *c, struct Object *o, Pack *p, const Word *head, const int64_t *lengths)
{
    const Word *table = table_of(c);
    const Image *image = o->image;
    size_t n_input = (size_t)table[T_N_INPUT].i, n_variable = (size_t)table[T_N_VARIABLE].i;
    pass(p, o->numbers, n_variable);
    pass(p, o->given, n_given(image));
    pass(p, o->now, (size_t)image->n_output);
    pass(p, o->moving, (size_t)head[S_N_STATE].i);
    pass(p, o->rows, (size_t)(head[S_N_ROW].i * image->n_output));
    pass(p, o->times, (size_t)head[S_N_ROW].i);
    pass(p, o->fields, (size_t)(head[S_N_FIELDS].i * size_of_fields(c)));
    for (size_t r = 0; r < n_variable; r++)
        if (variable(c, (int64_t)r)[V_KIND].i == STRING) {
            Word none = {0};
            size_t n_word = (size_t)lengths[r] / 8 + 1; /* with a zero behind it */
            if (p->how == WRITING) {
                /* zeros behind the text to the end of its last word: equal states have equal bytes */
                p->words[p->n + n_word - 1] = none;
                memcpy(p->words + p->n, o->texts[r], (size_t)lengths[r]);
                p->n += n_word;
            } else
                pass(p, o->texts[r], n_word);
        }
    lengths += n_variable;
    for (size_t i = 0; i < n_input; i++) pass(p, o->histories[i].t, 2 * (size_t)lengths[i]);
    lengths += n_input;
    for (size_t i = 0; i <= n_input; i++)
        if (lengths[i]) pass(p, o->arrays[i], (size_t)head[S_N_ARRAY].i);
}

static size_t n_length(const Instance *c) { return (size_t)(table_of(c)[T_N_VARIABLE].i + 2 * table_of(c)[T_N_INPUT].i + 1); }

/* A copy of what the instance is, as words; NULL without memory. */
static Word *packed(const Instance *c)
{
    Word head[S_HEADER], *words = NULL;
    int64_t *lengths = malloc(8 * n_length(c));
    if (lengths == NULL) return NULL;
    own_lengths(c, head, lengths);
    Pack p = {NULL, S_HEADER + n_length(c), COUNTING};
    pass_data(c, c->fmu, &p, head, lengths);
    head[S_N_WORD].u = p.n;
    words = malloc(8 * p.n);
    if (words != NULL) {
        p = (Pack){words, 0, WRITING};
        pass_lengths(c, &p, head, lengths);
        pass_data(c, c->fmu, &p, head, lengths);
    }
    free(lengths);
    return words;
}

/* -- restoring --------------------------------------------------------------------------------------------------------- */
static void free_read(struct Object *o)
{
    double *blocks[] = {o->numbers, o->given, o->now, o->rows, o->times, o->fields};
    free_variables(o);
    for (int i = 0; i < 6; i++) free(blocks[i]);
}

/* Memory for what a state holds; moving stays that of the instance. */
static int room_to_read(const Instance *c, struct Object *o, const Word *head, const int64_t *lengths)
{
    const Word *table = table_of(c);
    size_t n_input = (size_t)table[T_N_INPUT].i, n_variable = (size_t)table[T_N_VARIABLE].i;
    int good = 1;
    o->numbers = malloc(8 * n_variable);
    o->given = calloc(n_given(o->image), 8);
    o->now = malloc(8 * (size_t)o->image->n_output + 8);
    o->texts = calloc(n_variable, sizeof(char *));
    o->arrays = calloc(n_input + 1, sizeof(double *));
    o->histories = calloc(n_input + 1, sizeof(History));
    if (!o->numbers || !o->given || !o->now || !o->texts || !o->arrays || !o->histories) return 0;
    for (size_t r = 0; r < n_variable && good; r++)
        if (variable(c, (int64_t)r)[V_KIND].i == STRING)
            good = (o->texts[r] = malloc(8 * ((size_t)lengths[r] / 8 + 1))) != NULL;
    for (size_t i = 0; i < n_input && good; i++) {
        int64_t n = lengths[n_variable + i];
        double *block = malloc(16 * (size_t)n + 8);
        o->histories[i] = (History){n, block, block ? block + n : NULL, 0};
        good = block != NULL;
    }
    for (size_t i = 0; i <= n_input && good; i++)
        if (lengths[n_variable + n_input + i])
            good = (o->arrays[i] = malloc(8 * (size_t)head[S_N_ARRAY].i)) != NULL;
    return good && room_for(o, head[S_N_ROW].i, head[S_N_FIELDS].i, size_of_fields(c));
}

/* Whether the solution of prescribed mode that an instance has is that of another's histories. */
static int same_solution(const Instance *c, const struct Object *a, const struct Object *b)
{
    int64_t n_input = table_of(c)[T_N_INPUT].i, end = table_of(c)[T_END].i, mode = table_of(c)[T_MODE].i;
    if (a->n_row < 2 || a->numbers[mode] != PRESCRIBED || a->numbers[end] != b->numbers[end]) return 0;
    if (memcmp(a->first, b->first, 16 * (size_t)n_input) != 0) return 0;
    for (int64_t r = 0; r < table_of(c)[T_N_VARIABLE].i; r++)
        if (variable(c, r)[V_ROLE].i == TUNABLE && a->numbers[r] != b->numbers[r]) return 0;
    for (int64_t i = 0; i < n_input; i++)
        if (a->histories[i].n != b->histories[i].n ||
            (a->histories[i].n && memcmp(a->histories[i].t, b->histories[i].t, 16 * (size_t)a->histories[i].n) != 0))
            return 0;
    return 1;
}

static void swap_blocks(double **a, double **b)
{
    double *kept = *a;
    *a = *b;
    *b = kept;
}

static int unpacked(Instance *c, Word *words)
{
    /* everything that is not read stays that of the instance */
    struct Object *o = c->fmu, fresh = *o;
    Word head[S_HEADER];
    int64_t *lengths = malloc(8 * n_length(c));
    if (lengths == NULL) return msg(c, ERROR, "no memory to restore the state");
    Pack p = {words, 0, READING};
    pass_lengths(c, &p, head, lengths);
    fresh.numbers = fresh.given = fresh.now = fresh.rows = fresh.times = fresh.fields = NULL;
    fresh.texts = NULL, fresh.arrays = NULL, fresh.histories = NULL;
    int good = room_to_read(c, &fresh, head, lengths);
    if (good) {
        pass_data(c, &fresh, &p, head, lengths); /* the state itself into the moving block of both */
        set_places(&fresh);
        fresh.discarded = head[S_DISCARDED].i;
        fresh.acted = 1; /* the inputs before the state are not known */
        fresh.n_array = head[S_N_ARRAY].i;
        fresh.start = head[S_START].d;
        fresh.n_row = head[S_N_ROW].i;
        fresh.n_fields = head[S_N_FIELDS].i;
        if (same_solution(c, o, &fresh)) {
            swap_blocks(&o->rows, &fresh.rows);
            swap_blocks(&o->times, &fresh.times);
            swap_blocks(&o->fields, &fresh.fields);
            fresh.n_row = o->n_row;
            fresh.n_fields = o->n_fields;
        }
        struct Object old = *o;
        *o = fresh;
        fresh = old;
        c->time = head[S_TIME].d;
        o->accuracy = head[S_ACCURACY].d;
        c->phase = (int)head[S_PHASE].i;
        c->last = OK;
        o->opened = 0; /* outputs at the start are computed anew */
        no_step(o);
        go_on_from(c, head[S_RECORD].u);
    }
    free_read(&fresh);
    free(lengths);
    return good ? OK : msg(c, ERROR, "no memory to restore the state");
}

static int restored(Instance *c, Word *words)
{
    int status = unpacked(c, words);
    struct Object *o = c->fmu;
    if (status != OK || o->n_row > 0 || !is_prescribed(c) || c->phase < EVENT) return status;
    double *now = malloc(8 * (size_t)o->image->n_output + 8);
    if (now == NULL) return msg(c, ERROR, "no memory to restore the state");
    /* outputs are those of the state, and not of the start, to which the solution returns */
    memcpy(now, o->now, 8 * (size_t)o->image->n_output);
    status = solve_histories(c);
    memcpy(o->now, now, 8 * (size_t)o->image->n_output);
    free(now);
    return status;
}

/* -- the check of what comes from outside -------------------------------------------------------------------------------- */
static const char *trouble_of(const Instance *c, const Word *words, size_t size)
{
    const Word *table = table_of(c);
    size_t n_word = size / 8, prefix = S_HEADER + n_length(c);
    if (size < 8 || memcmp(words, magic, 8) != 0) return "it does not begin like a state";
    if (size % 8 || n_word < prefix || words[S_N_WORD].u != n_word ||
        words[S_CHECKSUM].u != checksum(words + S_N_WORD, n_word - S_N_WORD))
        return "it is damaged (its checksum does not match); use an intact copy";
    if (words[S_TABLE].u != table[T_CHECKSUM].u) return "it belongs to another FMU; use it with that FMU";
    int64_t n_variable = table[T_N_VARIABLE].i, n_input = table[T_N_INPUT].i, most = (int64_t)n_word;
    const Word *lengths = words + S_HEADER;
    for (int64_t i = 0; i < (int64_t)n_length(c); i++)
        /* the words of the block bound every length: nothing is allocated for more */
        if (lengths[i].i < 0 || lengths[i].i > 8 * most || (i >= n_variable + n_input && lengths[i].i > 1) ||
            (i < n_variable && lengths[i].i && variable(c, i)[V_KIND].i != STRING))
            return "it contains an invalid length";
    int64_t phase = words[S_PHASE].i;
    if (phase < INSTANTIATED || phase > TERMINATED || phase == EVENT || phase == CONTINUOUS ||
        words[S_DISCARDED].u > 1 || words[S_N_ROW].u > (uint64_t)most ||
        words[S_N_FIELDS].u > words[S_N_ROW].u || words[S_N_ARRAY].i < 1 || words[S_N_ARRAY].i > most + 1 ||
        !isfinite(words[S_START].d) || !isfinite(words[S_TIME].d) || !isfinite(words[S_ACCURACY].d))
        return "its header contains an invalid number";
    int64_t n_state = words[S_N_STATE].i;
    /* before the image is made there is none */
    if (n_state < 0 || n_state > most || (n_state == 0 && phase >= EVENT) ||
        (n_state > 0 && c->fmu->image->head != NULL && n_state != c->fmu->image->n_state))
        return "its sizes are not those of this FMU";
    /* lengths and sizes are checked before any datum is read */
    Pack p = {NULL, prefix, COUNTING};
    pass_data(c, c->fmu, &p, words, &lengths->i);
    return p.n == n_word ? NULL : "its sizes are not those of this FMU";
}

static int all_finite(const Word *words, size_t n)
{
    for (size_t i = 0; i < n; i++)
        if (!isfinite(words[i].d)) return 0;
    return 1;
}

/* Numbers of a state whose sizes fit. */
static const char *wrong_number(const Instance *c, const Word *words)
{
    const Word *table = table_of(c), *lengths = words + S_HEADER, *at = lengths + n_length(c);
    const Word *of_run = c->fmu->image->run_table;
    const Image *image = c->fmu->image;
    int64_t n_variable = table[T_N_VARIABLE].i, n_input = table[T_N_INPUT].i, n_row = words[S_N_ROW].i;
    for (int64_t r = 0; r < n_variable; r++) {
        const Word *v = variable(c, r);
        double value = at[r].d;
        if (!isfinite(value) || ((v[V_KIND].i == INTEGER || v[V_KIND].i == COUNT) && value != rint(value)) ||
            (v[V_KIND].i == COUNT && !(value >= 1.0 && value <= 1e5)) || (v[V_ROLE].i == CONSTANT && value != v[V_START].d) ||
            (v[V_ROLE].i == TUNABLE && value < 0.0))
            return "a parameter in it cannot be";
    }
    int64_t size = table[T_HISTORY_SIZE].i, mode = table[T_MODE].i, rule = table[T_RULE].i;
    if (size >= 0 && at[size].d != (double)words[S_N_ARRAY].i) return "the stated length of its arrays does not match";
    int prescribed = at[mode].d == PRESCRIBED, begun = words[S_PHASE].i >= EVENT;
    if (begun && (at[mode].d < 0.0 || at[mode].d > 1.0 || at[rule].d < 0.0 || at[rule].d > 3.0))
        return "a parameter in it cannot be";
    if (begun && ((n_row > 0) == prescribed || words[S_N_FIELDS].i != rows_with_fields(c, n_row)))
        return "it contains outputs without a step, or a step without outputs";
    at += n_variable;
    size_t numbers = n_given(image) + (size_t)image->n_output;
    if (!all_finite(at, numbers)) return "a number in it is not finite";
    at += numbers;
    for (int64_t i = 0; i < words[S_N_STATE].i; i++)
        /* what is not finite from the start on may be so here */
        if (!isfinite(at[i].d) && isfinite(image->moving[i])) return "a number in it is not finite";
    for (int64_t i = 0; of_run && i < of_run[T_N_WHOLE].i && words[S_N_STATE].i > 0; i++) {
        const Word *w = of_run + of_run[T_WHOLES].i + W_ROW * i;
        double value = at[w[W_PLACE].i].d;
        if (value != rint(value) || value < w[W_LEAST].d || value > w[W_MOST].d) return "its run contains an invalid number";
    }
    at += words[S_N_STATE].i;
    numbers = (size_t)(n_row * (image->n_output + 1) + words[S_N_FIELDS].i * size_of_fields(c));
    if (!all_finite(at, numbers)) return "a number in it is not finite";
    at += numbers;
    for (int64_t r = 0; r < n_variable; r++)
        if (variable(c, r)[V_KIND].i == STRING) {
            const char *text = (const char *)at, *end = memchr(text, 0, 8 * (size_t)(lengths[r].i / 8 + 1));
            if (end != text + lengths[r].i) return "a text in it has another length than stated";
            for (; end < text + 8 * (lengths[r].i / 8 + 1); end++) /* zeros to the end of its last word */
                if (*end != 0) return "a text in it has another length than stated";
            at += lengths[r].i / 8 + 1;
        }
    lengths += n_variable;
    for (int64_t i = 0; i < n_input; at += 2 * lengths[i++].i) {
        if (!all_finite(at, 2 * (size_t)lengths[i].i)) return "it contains a history that is not finite";
        for (int64_t k = 1; k < lengths[i].i; k++)
            if (!(at[k].d > at[k - 1].d)) return "it contains a history whose times do not increase";
    }
    return NULL;
}

/* -- functions of the FMI ---------------------------------------------------------------------------------------------- */
static int place_of(const Instance *c, const void *state, size_t *place)
{
    for (*place = 0; *place < c->fmu->n_state; ++*place)
        if (c->fmu->states[*place] == state) return 1;
    return msg(c, ERROR, "the state does not belong to this instance, or was freed: serialize a state to pass it to another "
               "instance"), 0;
}

static int kept_state(Instance *c, Word *words, void **state)
{
    struct Object *o = c->fmu;
    void **states = words ? realloc(o->states, (o->n_state + 1) * sizeof *states) : NULL;
    if (states == NULL) {
        free(words);
        return msg(c, ERROR, "no memory for the state");
    }
    o->states = states;
    states[o->n_state++] = *state = words;
    return OK;
}

int get_state(Instance *c, void **state)
{
    size_t place;
    if (*state == NULL) return kept_state(c, packed(c), state);
    if (!place_of(c, *state, &place)) return ERROR;
    Word *words = packed(c);
    if (words == NULL) return msg(c, ERROR, "no memory for the state");
    free(*state);
    c->fmu->states[place] = *state = words;
    return OK;
}

/* Makes the image that the state of a simulation is of, where images are made. */
static int made_for(Instance *c, const Word *words)
{
#if defined(LATIN_FMU_MAKES)
    const int64_t *lengths = &words[S_HEADER].i;
    const double *numbers = &words[S_HEADER + n_length(c)].d;
    int64_t n_variable = table_of(c)[T_N_VARIABLE].i, n_input = table_of(c)[T_N_INPUT].i;
    const double *first = numbers + n_variable + 2 * n_input;
    const Word *at = words + words[S_N_WORD].u; /* behind the arrays; the histories are before them */
    if (words[S_PHASE].i < EVENT) return OK;
    double *starts = malloc(8 * (size_t)n_input + 8);
    if (starts == NULL) return msg(c, ERROR, "no memory to restore the state");
    for (int64_t i = 0; i <= n_input; i++) at -= lengths[n_variable + n_input + i] ? words[S_N_ARRAY].i : 0;
    for (int64_t i = n_input - 1; i >= 0; i--) {
        int64_t n = lengths[n_variable + i];
        at -= 2 * n;
        History h = {n, (double *)&at->d, (double *)&at->d + n, 0};
        starts[i] = n > 0 ? history_at(&h, 0.0) : first[2 * i];
    }
    c->fmu->accuracy = words[S_ACCURACY].d;
    int status = make_image(c, numbers, starts);
    free(starts);
    return status;
#else
    return (void)c, (void)words, OK;
#endif
}

int set_state(Instance *c, void *state)
{
    size_t place;
    if (!place_of(c, state, &place)) return ERROR;
    Word *before = packed(c);
    if (before == NULL) return msg(c, ERROR, "no memory to restore the state");
    int status = made_for(c, state);
    if (status == OK) status = restored(c, state);
    /* a solution may fail half way */
    if (status != OK && made_for(c, before) == OK) restored(c, before);
    free(before);
    return status;
}

int free_state(Instance *c, void **state)
{
    size_t place;
    if (state == NULL || *state == NULL) return OK;
    if (!place_of(c, *state, &place)) return ERROR;
    free(*state);
    c->fmu->states[place] = c->fmu->states[--c->fmu->n_state];  /* the last one fills the gap */
    *state = NULL;
    return OK;
}

void free_states(struct Object *o)
{
    while (o->n_state > 0) free(o->states[--o->n_state]);
    free(o->states);
}

int state_size(Instance *c, void *state, size_t *size)
{
    size_t place;
    if (!place_of(c, state, &place)) return ERROR;
    *size = 8 * ((Word *)state)[S_N_WORD].u;
    return OK;
}

int state_to_bytes(Instance *c, void *state, char *bytes, size_t size)
{
    size_t place, own;
    if (!place_of(c, state, &place)) return ERROR;
    Word *words = state;
    own = 8 * words[S_N_WORD].u;
    if (size != own) return msg(c, ERROR, "the importer passes %zu bytes for a state of %zu bytes", size, own);
    /* states in memory have none: it is made where they leave */
    words[S_CHECKSUM].u = checksum(words + S_N_WORD, words[S_N_WORD].u - S_N_WORD);
    memcpy(bytes, words, own);
    return OK;
}

int state_from_bytes(Instance *c, const char *bytes, size_t size, void **state)
{
    Word *words = malloc(size + 8); /* the bytes of the host lie anywhere */
    if (words == NULL) return msg(c, ERROR, "no memory for the state");
    memcpy(words, bytes, size);
    const char *trouble = trouble_of(c, words, size);
    /* what it is compared with is of the image */
    if (trouble == NULL && c->fmu->image->head == NULL && made_for(c, words) != OK) return free(words), ERROR;
    if (trouble == NULL) trouble = wrong_number(c, words);
    if (trouble == NULL) return kept_state(c, words, state);
    free(words);
    return msg(c, ERROR, "the state cannot be used: %s", trouble);
}
