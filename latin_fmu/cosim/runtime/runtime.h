/* An instance of the runtime: variables, a moving block of the run, what the last step left.

   image.c reads the files of an FMU, once per process; process.c takes an image that is in memory already; variables.c sets
   and reads variables; run.c makes steps by the kernels; derivatives.c differentiates the last one; states.c saves and
   restores; results.c writes. Instances share nothing that changes but the list of files in image.c. */
#ifndef RUNTIME_H
#define RUNTIME_H

#include "instance.h"

#include <math.h>
#include <stdio.h>

/* A number of 8 bytes of the files, little-endian. */
typedef union {
    int64_t i;
    uint64_t u;
    double d;
} Word;

/* The table of variables: its header, rows of variables and inputs, whole numbers of the state, texts. Offsets of texts count
   from T_TEXTS, which counts words, as the other places do. References are -1 where there is no such variable. T_UNLOADED: 1
   where nothing but the inputs loads or moves a body. */
enum {
    T_MAGIC, T_CHECKSUM, T_LENGTH, T_TOKEN, T_IMAGE, T_N_VARIABLE, T_VARIABLES, T_N_INPUT, T_INPUTS, T_TEXTS, T_MODE, T_RULE, T_END, T_FILE, T_WINDOW_SIZE, T_HISTORY_SIZE, T_SOLVER,
    T_TOLERANCE, T_N_WHOLE, T_WHOLES, T_RESULTS, T_N_RECORD, T_RECORDS, T_RESULTS_SUM, T_UNLOADED, T_N_PRESSED, T_PRESSED, T_HEADER
};
/* Numbers of the state that stand for whole ones: their place in the moving block, the least and the largest. */
enum { W_PLACE, W_LEAST, W_MOST, W_ROW };
/* What a record of the results file holds: the time, outputs or fields of the points from a place on, their number, whether
   they are whole numbers of 4 bytes. */
enum { R_KIND, R_PLACE, R_COUNT, R_WHOLE, R_ROW };
enum { R_TIME, R_OUTPUT, R_FIELD };
/* A point at which a rigid body is pressed at the start: place of its traction, components, friction, name of the interface,
   place of the friction where it is tunable, else -1. */
enum { P_PLACE, P_SIZE, P_FRICTION, P_NAME, P_TUNED, P_ROW };
enum { V_NAME, V_KIND, V_ROLE, V_PLACE, V_WIDTH, V_N_DIMENSION, V_DIMENSION, V_START = V_DIMENSION + 3, V_ROW };
enum { REAL, INTEGER, STRING, COUNT };
enum {
    TIME, CONSTANT, PARAMETER, VALUE, RATE, OUTPUT, TEXT, HISTORY_TIME, HISTORY, WINDOW_COUNT, WINDOW_TIME, WINDOW,
    POINT_FIELD, VECTOR, TUNABLE
};
/* Of a TUNABLE: V_PLACE in the moving block of the first of V_WIDTH points, V_DIMENSION numbers from one to the next. */
/* Name in a table of histories, names of value and rate, reference of the value. */
enum { IN_NAME, IN_VALUE, IN_RATE, IN_REFERENCE, IN_ROW };
enum { WINDOWED, PRESCRIBED };
enum { HOLD, BY_RATE, LINE, CAUSAL, PATH };

/* The image of the run: its header, in the order of latin_fmu/cosim/communication.py. */
enum {
    M_MAGIC, M_VERSION, M_RUN_SIZE, M_N_CLASS, M_CLASS_SIZE, M_N_GROUP, M_GROUP_SIZE, M_N_FIXED, M_N_MOVING, M_N_STATE,
    M_N_INPUT, M_N_OUTPUT, M_N_ROW, M_MOST_STEPS, M_VALUE, M_RATE, M_OUTPUT, M_PROGRESS, M_LAST_STEP, M_N_FIELD, M_FIELD,
    M_COMMUNICATE, M_PRESENT, M_FIELDS, M_RUN_DIGEST, M_OF_EVENT, M_PLACE, M_PLACING, M_DERIVE,
    M_DEPTH_AT, M_RELAXATION_AT, M_N_PRODUCT, M_DT = 33, M_HEADER = 41
};

/* What a process hands over that has made the image itself (latin_fmu/cosim/engine.py). The records and the blocks stay its
   own: it may change what is constant between two calls, and its functions for laws and factors (callouts) find the moving
   block where they expect it. kernels: their entry. notify: NULL, or called at the moments below; a result other than 0 stops
   the step. */
typedef struct {
    const Word *table;
    int64_t n_table;
    const Word *head;
    const void *records[3];
    const double *fixed;
    double *moving;
    int32_t (*kernels)(const int64_t *slots, void *result);
    int64_t (*notify)(int64_t what, int64_t a, int64_t b, int64_t c);
    const char *trouble; /* why notify has stopped a step */
    int64_t whole;       /* whether fields of the points are kept at all instants of a step */
    int64_t always;      /* whether notify is called before and after each call of the kernels */
    int64_t *answered;   /* set by notify; else a signal has ended it before its first line, and the step is stopped */
} Process;
/* ABOUT_TO: make b time steps, after a since the start, of a communication step of c; HAVE_MADE: b of those that were wanted,
   behind a of c; WORKS_ON: the kernels work on the moving block at address a, of b numbers, until the next one. */
enum { ABOUT_TO, HAVE_MADE, WORKS_ON };

typedef struct Image Image;
struct Image {
    Image *next;
    char *folder;
    size_t users;
    Word *table, *head; /* the files; the blocks of the image follow its header */
    size_t shift;       /* words before the header in its memory */
    const char *records[3]; /* of the run, of classes, of groups */
    const double *fixed, *moving;
    const Word *products;   /* tables that are left out of the file */
    int64_t n_output, n_state;
    double dt;
    const Process *process; /* NULL: the image is from files */
    const Word *run_table;  /* table with what belongs to the run: whole numbers of its state, points pressed at the start */
    int owns_table;
    int unlisted;           /* whether it is of one instance alone, and not in the list */
};

const Image *image_of(const char *folder, const char *token, char *trouble, size_t size);
void image_freed(const Image *);
const Image *image_of_table(const char *folder, const char *token, char *trouble, size_t size); /* head: NULL */
const Image *image_in_memory(const Process *, const Image *files); /* files: NULL, or what the table and the folder are of */
int fits(const Word *table, size_t n_word);
uint64_t checksum(const void *words, size_t n_word);
char *joined(const char *folder, const char *name);
FILE *file_at(const char *path, const char *how);
int moved_file(const char *from, const char *to); /* over the file that is there */
void removed_file(const char *path);
int is_irregular(const char *path);
char *content_of(const char *path, size_t *length); /* zero bytes behind it; freed by aligned_free */
void *aligned(size_t bytes);
void aligned_free(void *);

/* from_process: given by the process, not by a table of the host. */
typedef struct {
    int64_t n;
    double *t, *value; /* one block, at t */
    int64_t from_process;
} History;

/* Rows of n instants from the first on: a number that no other row of the process has, outputs, fields of the points.
   lost: there was no memory for one. */
typedef struct {
    Word *rows;
    int64_t room, first, n;
    int lost;
} Records;

/* The last step, for derivatives: state before it, value and rate of the inputs in it; its time, size, time steps, and those
   after which it ended. columns: derivatives of the outputs by value and rate of each input, NULL before the first request.
   known: whether there is such a step. */
typedef struct {
    double *state, *given, **columns;
    double t, h;
    int64_t whole, ended, known;
} LastStep;

struct Object {
    const Image *image;
    int64_t discarded, opened; /* whether the last step was; whether the outputs at the start follow from what is set */
    int64_t acted;             /* whether an input has had another value than 0 */
    double *moving, *before; /* block of the run; its state, the first numbers of it, before a step */
    char *relaxed;           /* record of the run for a time step that has stalled */
    LastStep made;
    int64_t slots[23];       /* of a call of the kernels: address and length of nine arrays, five numbers */
    int32_t (*kernels)(const int64_t *slots, void *result);
    double *numbers;         /* by reference */
    double *given;           /* value and rate of each input; behind them, of one allocation: */
    double *first;           /* those at the start */
    double *refused;         /* t, h and those of the last step where it was discarded */
    char **texts;            /* by reference */
    double **arrays;         /* histories given as arrays, by input, then their instants; NULL where none was given */
    int64_t n_array;         /* their length */
    History *histories;      /* of prescribed mode, by input; n = 0: constant */
    double start;            /* time of the host at the start, s */
    double *now;             /* outputs at the present time */
    double *rows, *times, *fields; /* of the last step: outputs, instants (s from the start); fields of the points */
    int64_t n_row, n_fields;
    int64_t ended;           /* time steps of the last step, -1 where it moved the clock alone */
    Records records;         /* for the results file */
    void **states;           /* given to the host */
    size_t n_state;
    void *maker;             /* of the image, where it is made when a simulation begins; else NULL */
    double accuracy;         /* that the host wants then, 0 where it says nothing */
};

/* Makes the image for these values of the variables and of the inputs at the start, unless it is that; a status. Only in a
   library with LATIN_FMU_MAKES is an image made (fmu_build/bridge/make.c). */
#if defined(LATIN_FMU_MAKES)
int make_image(Instance *, const double *numbers, const double *starts);
int filled_from_files(Instance *, const char *token, const char *resources);
void free_maker(struct Object *);
char *table_of_file(Instance *, const char *path); /* a file as a text of rows, freed by free; NULL after a message */
#endif
int made_for_now(Instance *); /* the same for what is set; OK where the image is there from the beginning */

int msg(const Instance *, int status, const char *format, ...); /* logs a message; returns its status */
const Word *table_of(const Instance *);
const Word *variable(const Instance *, int64_t reference);
const char *text_at(const Instance *, int64_t offset);
const char *input_name(const Instance *, int64_t input, int part);
double parameter(const Instance *, int header, double otherwise);
int known(const Instance *, const uint32_t *references, size_t n); /* else after a message */

/* variables.c */
int start_variables(Instance *);
size_t n_given(const Image *); /* numbers of the allocation at given */
void set_places(struct Object *); /* of what lies behind given */
void free_variables(struct Object *);
int set_histories(Instance *);
int keep_history(Instance *, int64_t input, int64_t n, const double *t, const double *values, const char *where);
double history_at(const History *, double t);
int not_finite(const Instance *);

/* run.c */
int can_start(const Instance *); /* with what is set; else after a message */
int filled(Instance *, const Image *); /* a new object for an image; 0 after a message */
int take_image(Instance *, const Image *); /* in the place of the one that is there; 0 after a message */
int renewed(Instance *);
int has_arrays(const Instance *);
int64_t rows_with_fields(const Instance *, int64_t n_row); /* how many of the last rows have fields of the points */
int64_t size_of_fields(const Instance *);
int64_t row_now(const Instance *); /* of the present instant: in windowed mode the end of the step */
int room_for(struct Object *, int64_t n_row, int64_t n_fields, int64_t size_of_fields);
int solve_histories(Instance *);
enum { NO_MEMORY = INT32_MIN, STOPPED, BEYOND_LAWS = -1 };
int64_t act(struct Object *, int action, int64_t n, int64_t rule, int64_t made, int64_t whole); /* result of the kernels */
const char *relaxed_record(struct Object *); /* of the run, for a time step that has stalled */
int notified(const struct Object *, int64_t what, int64_t a, int64_t b, int64_t c); /* whether the process stops the step */
int64_t placed(Instance *, double t, double h);
int refused_by_kernels(const Instance *, int64_t result, double t, int status);

/* derivatives.c */
int derivable(Instance *, const uint32_t *unknowns, size_t n, const uint32_t *knowns, size_t m); /* else after a message */
int room_for_step(struct Object *);
void no_step(struct Object *);
void keep_step(struct Object *, double t, double h, int64_t whole, int64_t ended);
void free_step(struct Object *);

/* results.c */
int keeps_results(const Instance *);
void keep_record(const Instance *, int64_t instant, const double *outputs, const double *fields);
int has_record(const Instance *, int64_t instant);
void no_records(struct Object *);
uint64_t record_now(const Instance *); /* number of the row of the present instant; 0 where there is none */
void go_on_from(const Instance *, uint64_t record); /* after a state was restored: rows of another past are dropped */
int results_ready(const Instance *);
int write_results(const Instance *);

/* states.c */
void free_states(struct Object *);

#endif
