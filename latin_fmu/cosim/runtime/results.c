/* Results: one record for each instant that was accepted, written when the simulation is terminated.

   results.nc in the resources is a netCDF-3 file that lacks nothing but its records; the table of variables says what a
   record holds, in the order of the file. Numbers of netCDF-3 are big-endian. */
#include "runtime.h"

#include <stdio.h>

static const char file_name[] = "results.nc";

int keeps_results(const Instance *c)
{
    int64_t reference = table_of(c)[T_RESULTS].i;
    return reference >= 0 && *c->fmu->texts[reference];
}

static size_t width(const Instance *c) { return (size_t)(1 + c->fmu->image->n_output + size_of_fields(c)); }

static int64_t instant_now(const Instance *c)
{
    const struct Object *o = c->fmu;
    if (parameter(c, T_MODE, 0.0) == PRESCRIBED || o->moving == NULL) return o->n_row - 1;
    return (int64_t)o->moving[o->image->head[M_PROGRESS].i];
}

static Word *row_of(const Instance *c, int64_t instant)
{
    const Records *r = &c->fmu->records;
    return instant < r->first || instant >= r->first + r->n ? NULL : r->rows + (size_t)(instant - r->first) * width(c);
}

/* Keeps outputs and fields of an instant. Instants are kept in their order: a row that is written again drops those behind
   it, so that a row and all before it are of one past as long as its number is the same. */
void keep_record(const Instance *c, int64_t instant, const double *outputs, const double *fields)
{
    static uint64_t last;
    struct Object *o = c->fmu;
    Records *r = &o->records;
    size_t n = width(c), n_output = (size_t)o->image->n_output;
    if (instant < r->first || instant > r->first + r->n) *r = (Records){r->rows, r->room, instant, 0, r->lost};
    int64_t row = instant - r->first;
    if (row >= r->room) {
        int64_t room = 2 * row + 16;
        Word *rows = realloc(r->rows, 8 * (size_t)room * n);
        if (rows == NULL) {
            if (!r->lost) msg(c, WARNING, "insufficient memory for the results: they will not be written");
            r->lost = 1;
            return;
        }
        r->rows = rows;
        r->room = room;
    }
    Word *to = r->rows + (size_t)row * n;
    to->u = (uint64_t)(uintptr_t)&last + __atomic_add_fetch(&last, 1, __ATOMIC_RELAXED); /* the address is another in each process */
    memcpy(to + 1, outputs, 8 * n_output);
    memcpy(to + 1 + n_output, fields, 8 * (size_t)size_of_fields(c));
    r->n = row + 1;
}

int has_record(const Instance *c, int64_t instant) { return row_of(c, instant) != NULL; }

void no_records(struct Object *o) { o->records = (Records){o->records.rows, o->records.room, 0, 0, 0}; }

uint64_t record_now(const Instance *c)
{
    const Word *row = keeps_results(c) ? row_of(c, instant_now(c)) : NULL;
    return row ? row->u : 0;
}

void go_on_from(const Instance *c, uint64_t record)
{
    Records *r = &c->fmu->records;
    if (keeps_results(c) && record_now(c) != record) *r = (Records){r->rows, r->room, instant_now(c), 0, r->lost};
}

/* -- the file ---------------------------------------------------------------------------------------------------------- */
static unsigned char *put_bytes(unsigned char *to, uint64_t bits, int n_byte)
{
    for (int i = 0; i < n_byte; i++) to[i] = (unsigned char)(bits >> 8 * (n_byte - 1 - i));
    return to + n_byte;
}

static unsigned char *put_number(unsigned char *to, double value, int64_t whole)
{
    Word word = {.d = value};
    /* through the signed type: a negative number keeps its bits */
    return whole ? put_bytes(to, (uint32_t)(int32_t)value, 4) : put_bytes(to, word.u, 8);
}

static unsigned char *put_record(const Instance *c, int64_t row, unsigned char *to)
{
    const struct Object *o = c->fmu;
    const Word *table = table_of(c), *of_file = table + table[T_RECORDS].i;
    const Word *numbers = o->records.rows + (size_t)row * width(c) + 1;
    for (int64_t i = 0; i < table[T_N_RECORD].i; i++, of_file += R_ROW) {
        int64_t place = of_file[R_PLACE].i + (of_file[R_KIND].i == R_FIELD ? o->image->n_output : 0);
        for (int64_t k = 0; k < of_file[R_COUNT].i; k++) {
            double value = of_file[R_KIND].i == R_TIME ? (double)(o->records.first + row) * o->image->dt : numbers[place + k].d;
            to = put_number(to, value, of_file[R_WHOLE].i);
        }
    }
    return to;
}

static size_t size_of_record(const Instance *c)
{
    const Word *table = table_of(c), *of_file = table + table[T_RECORDS].i;
    size_t size = 0;
    for (int64_t i = 0; i < table[T_N_RECORD].i; i++, of_file += R_ROW)
        size += (size_t)(of_file[R_COUNT].i * (of_file[R_WHOLE].i ? 4 : 8));
    return size;
}

static int written(const Instance *c, FILE *file, unsigned char *head, size_t length, int64_t n)
{
    size_t size = size_of_record(c);
    unsigned char *record = malloc(size + 1);
    put_bytes(head + 4, (uint64_t)n, 4); /* the number of records stands behind the magic number */
    int good = record != NULL && fwrite(head, 1, length, file) == length;
    for (int64_t row = 0; row < n && good; row++) {
        put_record(c, row, record);
        good = fwrite(record, 1, size, file) == size;
    }
    free(record);
    return good;
}

/* What every results file begins with; NULL after a message. */
static unsigned char *head_of(const Instance *c, size_t *length)
{
    const Image *image = c->fmu->image;
    char *path = joined(image->folder, file_name);
    char *head = path ? content_of(path, length) : NULL;
    free(path);
    if (head == NULL)
        msg(c, ERROR, "%s/%s cannot be read: extract the whole FMU", image->folder, file_name);
    else if (*length < 8 || checksum(head, (*length + 7) / 8) != image->table[T_RESULTS_SUM].u) {
        msg(c, ERROR, "%s/%s is damaged, or of another FMU: extract the FMU again", image->folder, file_name);
        aligned_free(head);
        head = NULL;
    }
    return (unsigned char *)head;
}

static char *beside(const char *path)
{
    size_t size = strlen(path) + 6;
    char *other = malloc(size);
    if (other != NULL) snprintf(other, size, "%s.part", path);
    return other;
}

static int cannot_be_written(const Instance *c, const char *path)
{
    return msg(c, ERROR, "resultsFile: %.500s cannot be written: give a path in a writable folder", path);
}

/* Whether the file can be written when the simulation ends: known before it begins. */
int results_ready(const Instance *c)
{
    const char *path = c->fmu->texts[table_of(c)[T_RESULTS].i];
    size_t length = 0;
    unsigned char *head = head_of(c, &length);
    if (head == NULL) return ERROR;
    aligned_free(head);
    /* in this order: to open it for writing makes it */
    FILE *there = file_at(path, "rb"), *file = file_at(path, "ab"); /* a folder can be opened to read, not to write */
    if (there != NULL) fclose(there);
    if (file == NULL) return cannot_be_written(c, path);
    fclose(file);
    if (there == NULL) removed_file(path);  /* it was made by the line above */
    return OK;
}

/* The file is whole or not there: it is written beside its place first. */
static int replaced(const Instance *c, const char *path, unsigned char *head, size_t length, int64_t n)
{
    char *other = beside(path);
    FILE *file = other ? file_at(other, "wb") : NULL;
    int good = file != NULL;
    if (good) {
        good = written(c, file, head, length, n);
        good = fclose(file) == 0 && good;  /* what is buffered may not find room */
        good = good && moved_file(other, path);
        if (!good) removed_file(other);
    }
    free(other);
    return good;
}

int write_results(const Instance *c)
{
    const struct Object *o = c->fmu;
    const char *path = o->texts[table_of(c)[T_RESULTS].i];
    int64_t now = instant_now(c);
    int64_t first = o->records.first, n = now + 1 - first;
    if (o->records.lost) return msg(c, ERROR, "%.500s was not written: insufficient memory for the results", path);
    if (n > o->records.n || n < 1) n = 0; /* a state was restored, and no step followed */
    size_t length = 0;
    unsigned char *head = head_of(c, &length);
    if (head == NULL) return ERROR;
    int good = replaced(c, path, head, length, n);
    aligned_free(head);
    if (!good) return cannot_be_written(c, path);
    if (n < 1 || first > 0)
        msg(c, WARNING, "%.500s begins at %g s: earlier instants were before a restored state", path,
            (double)(n < 1 ? now : first) * o->image->dt);
    return OK;
}
