/* Variables by value reference: what they are is in the table. Histories of prescribed mode. */
#include "runtime.h"

#include <ctype.h>
#include <locale.h>
#include <stdio.h>

const Word *table_of(const Instance *c) { return c->fmu->image->table; }

const char *text_at(const Instance *c, int64_t offset)
{
    return (const char *)(table_of(c) + table_of(c)[T_TEXTS].i) + offset;
}

const Word *variable(const Instance *c, int64_t reference)
{
    return table_of(c) + table_of(c)[T_VARIABLES].i + reference * V_ROW;
}

const char *input_name(const Instance *c, int64_t input, int part)
{
    return text_at(c, table_of(c)[table_of(c)[T_INPUTS].i + IN_ROW * input + part].i);
}

double parameter(const Instance *c, int header, double otherwise)
{
    int64_t reference = table_of(c)[header].i;
    return reference < 0 ? otherwise : c->fmu->numbers[reference];
}

int known(const Instance *c, const uint32_t *references, size_t n)
{
    int64_t count = table_of(c)[T_N_VARIABLE].i;
    for (size_t i = 0; i < n; i++)
        if (references[i] >= count)
            return msg(c, ERROR, "there is no variable with the value reference %lu; allowed: 0 to %lld",
                       (unsigned long)references[i], (long long)count - 1), 0;
    return 1;
}

static const char *name(const Instance *c, int64_t reference) { return text_at(c, variable(c, reference)[V_NAME].i); }

static size_t elements(const Instance *c, int64_t reference)
{
    const Word *v = variable(c, reference);
    size_t count = 1;
    for (int64_t i = 0; i < v[V_N_DIMENSION].i; i++) { /* below 0: -1 - reference of a size */
        int64_t size = v[V_DIMENSION + i].i;
        count *= (size_t)(size < 0 ? c->fmu->numbers[-1 - size] : (double)size);
    }
    return count;
}

size_t n_given(const Image *image) { return (size_t)(6 * image->table[T_N_INPUT].i + 2); }

void set_places(struct Object *o)
{
    int64_t n_input = o->image->table[T_N_INPUT].i;
    o->first = o->given + 2 * n_input;
    o->refused = o->first + 2 * n_input;
}

/* -- start values ---------------------------------------------------------------------------------------------------- */
int start_variables(Instance *c)
{
    struct Object *o = c->fmu;
    int64_t count = table_of(c)[T_N_VARIABLE].i, n_input = table_of(c)[T_N_INPUT].i;
    free_variables(o);
    if (o->numbers == NULL) o->numbers = calloc((size_t)count, sizeof(double));
    if (o->given == NULL) o->given = calloc(n_given(o->image), sizeof(double));
    o->texts = calloc((size_t)count, sizeof(char *));
    o->arrays = calloc((size_t)n_input + 1, sizeof(double *));
    o->histories = calloc((size_t)n_input + 1, sizeof(History));
    if (!o->numbers || !o->given || !o->texts || !o->arrays || !o->histories) return 0;
    set_places(o);
    for (int64_t r = 0; r < count; r++) {
        const Word *v = variable(c, r);
        if (v[V_KIND].i == STRING && (o->texts[r] = copied(text_at(c, v[V_START].i))) == NULL) return 0;
        o->numbers[r] = v[V_KIND].i == STRING || v[V_N_DIMENSION].i ? 0.0 : v[V_START].d;
        if (v[V_ROLE].i == VALUE || v[V_ROLE].i == RATE)
            o->given[2 * v[V_PLACE].i + (v[V_ROLE].i == RATE)] = v[V_START].d;
    }
    o->n_array = (int64_t)parameter(c, T_HISTORY_SIZE, 1.0);
    return 1;
}

void free_variables(struct Object *o)
{
    const Word *table = o->image->table;
    for (int64_t r = 0; o->texts && r < table[T_N_VARIABLE].i; r++) free(o->texts[r]);
    for (int64_t i = 0; o->arrays && i <= table[T_N_INPUT].i; i++) free(o->arrays[i]);
    for (int64_t i = 0; o->histories && i <= table[T_N_INPUT].i; i++) free(o->histories[i].t);
    free(o->texts);
    free(o->arrays);
    free(o->histories);
    o->texts = NULL;
    o->arrays = NULL;
    o->histories = NULL;
}

/* -- reading --------------------------------------------------------------------------------------------------------- */
/* Array with the instants of the last step as rows: the last ones where there are too many, 0 behind them. */
static void put_window(const Instance *c, int64_t size, const double *from, int64_t stride, int64_t width, double *to)
{
    const struct Object *o = c->fmu;
    int64_t skipped = o->n_row > size ? o->n_row - size : 0;
    for (int64_t row = 0; row < size; row++)
        for (int64_t k = 0; k < width; k++)
            *to++ = row + skipped < o->n_row ? from[(row + skipped) * stride + k] : 0.0;
}

/* Row of the fields of the points that belongs to the present time. */
static const double *fields_now(const Instance *c)
{
    const struct Object *o = c->fmu;
    if (o->n_fields == 0) return NULL;
    int64_t row = row_now(c);
    return o->fields + size_of_fields(c) * (row < o->n_fields ? row : o->n_fields - 1);
}

static void put(const Instance *c, int64_t reference, double *to, size_t count)
{
    const struct Object *o = c->fmu;
    const Word *v = variable(c, reference);
    int64_t place = v[V_PLACE].i, n_output = o->image->n_output;
    const double *field = v[V_ROLE].i == POINT_FIELD ? fields_now(c) : NULL;
    switch (v[V_ROLE].i) {
    case TIME: *to = c->time; break;
    case VALUE: *to = o->given[2 * place]; break;
    case RATE: *to = o->given[2 * place + 1]; break;
    case OUTPUT: *to = o->now[place]; break;
    case VECTOR: memcpy(to, o->now + place, count * sizeof *to); break;
    case WINDOW_COUNT: *to = fmin((double)o->n_row, parameter(c, T_WINDOW_SIZE, 1.0)); break;
    case WINDOW_TIME:
        put_window(c, (int64_t)count, o->times, 1, 1, to);
        for (int64_t i = 0; i < (int64_t)count && i < o->n_row; i++) to[i] += o->start;
        break;
    case WINDOW: put_window(c, (int64_t)count / v[V_WIDTH].i, o->rows + place, n_output, v[V_WIDTH].i, to); break;
    case POINT_FIELD:
        for (size_t i = 0; i < count; i++) to[i] = field ? field[place + (int64_t)i] : 0.0;
        break;
    case HISTORY_TIME:
    case HISTORY:
        for (size_t i = 0; i < count; i++) to[i] = o->arrays[place] ? o->arrays[place][i] : v[V_START].d;
        break;
    default: *to = o->numbers[reference];
    }
}

static int is_output(const Instance *c, int64_t reference)
{
    int64_t role = variable(c, reference)[V_ROLE].i;
    return role == OUTPUT || role == VECTOR || role == POINT_FIELD || role == WINDOW || role == WINDOW_COUNT || role == WINDOW_TIME;
}

int get_numbers(Instance *c, const uint32_t *references, size_t n, double *values, size_t size)
{
    size_t total = 0, at = 0;
    if (!known(c, references, n)) return ERROR;
    for (size_t i = 0; i < n; i++) {
        if (variable(c, references[i])[V_KIND].i == STRING)
            return msg(c, ERROR, "%s is a string: use the get function for strings", name(c, references[i]));
        total += elements(c, references[i]);
        /* known during initialization only after the solution, which is made here once */
        if (c->phase == INITIALIZATION && is_output(c, references[i]) && initialize(c) != OK) return ERROR;
    }
    if (size != total && size != n) /* a host that does not know arrays reads one number of each */
        return msg(c, ERROR, "the importer reads %zu values of variables with %zu values", size, total);
    for (size_t i = 0; i < n; i++) {
        size_t count = elements(c, references[i]);
        if (size == total || count == 1) {
            put(c, references[i], values + at, count);
            at += count;
            continue;
        }
        double *all = malloc(count * sizeof *all);
        if (all == NULL) return msg(c, ERROR, "no memory for %s", name(c, references[i]));
        put(c, references[i], all, count);
        values[at++] = all[0];
        free(all);
    }
    return OK;
}

int get_texts(Instance *c, const uint32_t *references, size_t n, const char **values, size_t size)
{
    if (!known(c, references, n)) return ERROR;
    for (size_t i = 0; i < n && i < size; i++) {
        values[i] = c->fmu->texts[references[i]];
        if (values[i] == NULL) return msg(c, ERROR, "%s is no string", name(c, references[i]));
    }
    return OK;
}

/* -- setting: nothing is set where one of the values is refused ------------------------------------------------------- */
static int refused(const Instance *c, int64_t reference, double value)
{
    const Word *v = variable(c, reference);
    int64_t kind = v[V_KIND].i, role = v[V_ROLE].i;
    const char *own = name(c, reference);
    if (role == VALUE || role == RATE) return OK;
    if (role == CONSTANT && fabs(value - v[V_START].d) <= 1e-9 * fabs(v[V_START].d)) return OK; /* as a host prints it */
    if (role == CONSTANT)
        return msg(c, ERROR, "%s = %g was not set: it is fixed at %g when a compiled FMU is exported; export another one from a "
                   "scene with this value", own, value, v[V_START].d);
    if (role == TUNABLE) {
        if (!(value >= 0.0 && isfinite(value)))
            return msg(c, ERROR, "%s = %g was not set: must be a finite number, 0 or more", own, value);
        if (c->phase >= EVENT && parameter(c, T_MODE, 0.0) == PRESCRIBED)
            return msg(c, ERROR, "%s was not set: in prescribed mode the whole interval was solved before", own);
        return OK;
    }
    if (role != PARAMETER && role != TEXT && role != HISTORY && role != HISTORY_TIME)
        return msg(c, ERROR, "%s is calculated and was not set", own);
    if (c->phase >= EVENT) return msg(c, ERROR, "%s is fixed after initialization and was not set", own);
    if (role != PARAMETER) return OK;
    if ((kind == INTEGER || kind == COUNT) && !(value == rint(value)))
        return msg(c, ERROR, "%s = %g was not set: must be an integer", own, value);
    if (kind == COUNT && !(value >= 1.0 && value <= 1e5))
        return msg(c, ERROR, "%s = %g was not set: must be from 1 to 100000", own, value);
    return OK;
}

static int set_array(Instance *c, int64_t reference, const double *values, size_t count)
{
    double **array = c->fmu->arrays + variable(c, reference)[V_PLACE].i;
    /* n_array elements: freed where this number changes */
    if (*array == NULL) *array = malloc(count * sizeof **array);
    if (*array == NULL) return msg(c, ERROR, "no memory for %s", name(c, reference));
    memcpy(*array, values, count * sizeof *values);
    return OK;
}

static void set_number(Instance *c, int64_t reference, double value)
{
    struct Object *o = c->fmu;
    const Word *v = variable(c, reference);
    int64_t place = v[V_PLACE].i, role = v[V_ROLE].i;
    if (role == VALUE || role == RATE) o->given[2 * place + (role == RATE)] = value;
    if (role != PARAMETER && role != TUNABLE) return;
    o->numbers[reference] = value;
    if (reference == table_of(c)[T_HISTORY_SIZE].i && (int64_t)value != o->n_array) { /* arrays are given anew */
        for (int64_t i = 0; i <= table_of(c)[T_N_INPUT].i; i++) {
            free(o->arrays[i]);
            o->arrays[i] = NULL;
        }
        o->n_array = (int64_t)value;
    }
}

int set_numbers(Instance *c, const uint32_t *references, size_t n, const double *values, size_t size)
{
    int status = OK;
    size_t at = 0;
    if (!known(c, references, n)) return ERROR;
    c->fmu->opened = 0;  /* the outputs at the start are computed anew */
    for (size_t i = 0; i < n; i++) {
        size_t count = elements(c, references[i]);
        if (variable(c, references[i])[V_ROLE].i == TEXT)
            return msg(c, ERROR, "%s is a string: use the set function for strings", name(c, references[i]));
        if (size < at + count)
            return msg(c, ERROR, "the importer passes %zu values; %s has %zu elements", size, name(c, references[i]), count);
        if (refused(c, references[i], values[at])) return ERROR;
        at += count;
    }
    for (size_t i = at = 0; i < n && status == OK; i++) {
        size_t count = elements(c, references[i]);
        if (size < at + count) return msg(c, ERROR, "set sizes of arrays in a separate call"); /* this call changed one */
        if (variable(c, references[i])[V_N_DIMENSION].i > 0)
            status = set_array(c, references[i], values + at, count);
        else
            set_number(c, references[i], values[at]);
        at += count;
    }
    return status;
}

int set_texts(Instance *c, const uint32_t *references, size_t n, const char *const *values, size_t size)
{
    if (!known(c, references, n)) return ERROR;
    c->fmu->opened = 0;
    for (size_t i = 0; i < n && i < size; i++) {
        if (c->fmu->texts[references[i]] == NULL) return msg(c, ERROR, "%s is no string", name(c, references[i]));
        if (refused(c, references[i], 0.0)) return ERROR;
    }
    for (size_t i = 0; i < n && i < size; i++) {
        char **text = c->fmu->texts + references[i], *copy = copied(values[i] ? values[i] : "");
        if (copy == NULL) return msg(c, ERROR, "no memory for %s", name(c, references[i]));
        free(*text);
        *text = copy;
    }
    return OK;
}

int not_finite(const Instance *c)
{
    for (int64_t i = 0; i < 2 * table_of(c)[T_N_INPUT].i; i++)
        if (!isfinite(c->fmu->given[i]))
            return (int)i + 1;
    return 0;
}

/* -- histories of prescribed mode -------------------------------------------------------------------------------------- */
double history_at(const History *h, double t)
{
    int64_t low = 0, high = h->n - 1;
    if (t <= h->t[0]) return h->value[0];
    if (t >= h->t[high]) return h->value[high];
    while (high - low > 1) {
        int64_t middle = (low + high) / 2;
        if (h->t[middle] <= t) low = middle;
        else high = middle;
    }
    double slope = (h->value[high] - h->value[low]) / (h->t[high] - h->t[low]);
    return h->value[low] + slope * (t - h->t[low]);
}

/* Writes what is wrong with a history, rows counted from 1; whether anything is. */
EXPORT int latin_fmu_wrong_history(int64_t n, const double *t, const double *values, char *text, size_t size)
{
    for (int64_t i = 0; i < n; i++) {
        long long row = (long long)i + 1;
        if (!isfinite(t[i]) || !isfinite(values[i]))
            return snprintf(text, size, "row %lld is not a pair of finite numbers", row), 1;
        if (i > 0 && !(t[i] > t[i - 1]))
            return snprintf(text, size, "the times must increase strictly; row %lld has %g s after %g s", row, t[i], t[i - 1]), 1;
    }
    return 0;
}

int keep_history(Instance *c, int64_t input, int64_t n, const double *t, const double *values, const char *where)
{
    History *h = c->fmu->histories + input;
    const char *own = input_name(c, input, IN_VALUE);
    char text[200];
    if (latin_fmu_wrong_history(n, t, values, text, sizeof text))
        return msg(c, ERROR, "%s: %s: %s", where, own, text);
    double *block = malloc((size_t)(2 * n + 1) * sizeof *block);
    if (block == NULL) return msg(c, ERROR, "no memory for the history of %s", own);
    free(h->t);
    *h = (History){n, block, block + n, 0};
    memcpy(h->t, t, (size_t)n * sizeof *t);
    memcpy(h->value, values, (size_t)n * sizeof *values);
    return OK;
}

/* Next cell of a table of text, up to a comma or the end of the line; what follows it, NULL at the end of the text. */
static const char *cell(const char *at, char *to, size_t size, int *last)
{
    size_t length = strcspn(at, ",;\r\n");
    const char *from = at, *end = at + length;
    *last = *end != ',';
    while (from < end && (*from == ' ' || *from == '\t' || *from == '"')) from++;
    while (end > from && (end[-1] == ' ' || end[-1] == '\t' || end[-1] == '"')) end--;
    size_t kept = (size_t)(end - from) < size ? (size_t)(end - from) : size - 1;
    memcpy(to, from, kept);
    to[kept] = '\0';
    at += length;
    if (*last) at += strspn(at, ";\r\n");
    else at++;
    return *at ? at : NULL;
}

/* A number with a point, whatever the host has chosen as its decimal sign. */
static int number_of(char *text, double *value)
{
    char *point = strchr(text, '.'), *end;
    if (point != NULL) *point = *localeconv()->decimal_point;  /* strtod reads that of the locale */
    *value = strtod(text, &end);
    return *text && *end == '\0';
}

enum { WIDEST = 1024 }; /* columns of a table, and letters of a cell */

/* Numbers of a table with a header, by columns (n_row each); inputs: of each column, -1 for the times. */
static int read_table(Instance *c, const char *text, const char *where, int64_t *inputs, int *n_column, double *numbers,
                      int64_t n_line, int64_t *n_row)
{
    char word[WIDEST];
    int last = 0, column = 0, timed = 0;
    const char *at = text;
    int64_t n_input = table_of(c)[T_N_INPUT].i;
    for (*n_column = 0; at != NULL && !last; ++*n_column) {
        if (*n_column == WIDEST) return msg(c, ERROR, "%s: more than %d columns", where, WIDEST);
        at = cell(at, word, sizeof word, &last);
        int64_t i = -1;
        if (strcmp(word, "time") == 0) timed = 1;
        else {
            for (i = 0; i < n_input && strcmp(word, input_name(c, i, IN_NAME)) != 0;) i++;
            if (i == n_input)
                return msg(c, ERROR, "%s: column %d: no input of this name", where, *n_column + 1);
        }
        for (column = 0; column < *n_column; column++)
            if (inputs[column] == i)
                return msg(c, ERROR, "%s: columns %d and %d have the same name", where, column + 1, *n_column + 1);
        inputs[*n_column] = i;
    }
    if (!timed) return msg(c, ERROR, "%s: no time column: name the column of times 'time'", where);
    for (*n_row = 0; at != NULL; ++*n_row) {
        for (column = 0, last = 0; at != NULL && !last; column++) {
            at = cell(at, word, sizeof word, &last);
            /* column after column */
            if (column >= *n_column || !number_of(word, numbers + (column * n_line + *n_row))) break;
        }
        if (!last || column != *n_column)
            return msg(c, ERROR, "%s: row %lld is not a row of %d numbers", where, (long long)*n_row + 2, *n_column);
    }
    return *n_row ? OK : msg(c, ERROR, "%s: no rows of numbers: a header line, then one line per instant", where);
}

static int set_from_text(Instance *c, const char *text, const char *where)
{
    int64_t inputs[WIDEST], n_line = 1, n_row = 0;
    int n_column = 0, times = 0;
    if (strncmp(text, "\xef\xbb\xbf", 3) == 0) text += 3; /* mark of the encoding */
    for (const char *at = text; *at; at++)
        n_line += *at == '\n' || *at == '\r' || *at == ';';
    size_t most = strcspn(text, ";\r\n"), width = 1;
    for (size_t i = 0; i < most; i++) width += text[i] == ',';
    double *numbers = calloc((size_t)n_line * width, sizeof *numbers);
    if (numbers == NULL) return msg(c, ERROR, "%s: no memory for the table", where);
    int status = read_table(c, text, where, inputs, &n_column, numbers, n_line, &n_row);
    for (int i = 0; i < n_column && status == OK; i++)
        if (inputs[i] < 0) times = i;
    for (int i = 0; i < n_column && status == OK; i++)
        if (inputs[i] >= 0)
            status = keep_history(c, inputs[i], n_row, numbers + times * n_line, numbers + i * n_line, where);
    free(numbers);
    return status;
}

/* Histories given as arrays, without the rows at the end that repeat the last one; all times equal: none is given. */
static int set_from_arrays(Instance *c)
{
    struct Object *o = c->fmu;
    int64_t n_input = table_of(c)[T_N_INPUT].i, last = o->n_array - 1, n = last;
    const double *t = o->arrays[n_input];
    int status = OK, varies = 0;
    /* the rows at the end that repeat the last instant */
    while (t != NULL && n > 0 && t[n - 1] == t[last]) n--;
    n = t == NULL ? 0 : n;
    for (int64_t i = 0; i < n_input; i++)
        for (int64_t k = n; o->arrays[i] && k < last; k++)
            if (o->arrays[i][k] != o->arrays[i][last]) varies = 1;
    if (varies)
        return msg(c, ERROR, "history.time: the instants from element %lld on are equal, but the amplitudes differ: give increasing "
                   "instants, and repeat the last row up to the size of the arrays", (long long)n + 1);
    for (int64_t i = 0; i < n_input && n > 0 && status == OK; i++)
        if (o->arrays[i] != NULL) status = keep_history(c, i, n + 1, t, o->arrays[i], "history.time");
    return status;
}

#if defined(LATIN_FMU_MAKES)
static int is_netcdf(const char *path)
{
    const char *suffix = strrchr(path, '.');
    return suffix != NULL && (strcmp(suffix, ".nc") == 0 || strcmp(suffix, ".nc4") == 0 || strcmp(suffix, ".cdf") == 0);
}
#endif

/* historyFile is the path of a CSV file, or the table itself: a text of rows; where there is Python also of a netCDF file. */
int set_histories(Instance *c)
{
    struct Object *o = c->fmu;
    int64_t reference = table_of(c)[T_FILE].i, n_input = table_of(c)[T_N_INPUT].i;
    const char *text = reference < 0 ? "" : o->texts[reference];
    int status = OK;
    for (int64_t i = 0; i < n_input; i++)
        if (!o->histories[i].from_process) o->histories[i].n = 0;
    if (parameter(c, T_MODE, 0.0) != PRESCRIBED) {
        if (*text) msg(c, WARNING, "historyFile has no effect in windowed mode: set mode = 1");
        return OK;
    }
    if (strpbrk(text, ";\r\n") != NULL)
        status = set_from_text(c, text, "table in historyFile");
    else if (*text && is_irregular(text))
        status = msg(c, ERROR, "%.500s: not a regular file", text);
#if defined(LATIN_FMU_MAKES)
    else if (is_netcdf(text)) {
        char *rows = table_of_file(c, text);
        status = rows ? set_from_text(c, rows, text) : ERROR;
        free(rows);
    }
#endif
    else if (*text) {
        size_t length = 0;
        char *content = content_of(text, &length);
        if (content == NULL)
            return msg(c, ERROR, "%.500s: no such file: give the path of a CSV file, or the table itself: "
                       "'time,NAME;0,0;1e-6,1'", text);
        status = strlen(content) == length
                     ? set_from_text(c, content, text)
                     : msg(c, ERROR, "%.500s: not a text: a compiled FMU reads CSV files, no netCDF", text);
        aligned_free(content);
    }
    return status == OK ? set_from_arrays(c) : status;
}
