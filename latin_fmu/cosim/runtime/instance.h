/* One instance of an FMU, and the logger of the host.

   fmi2.c and fmi3.c are the functions of the FMI; they call those declared here. The files beside them define these by
   kernels, python.c (fmu_build/bridge) by the methods of a Python object. common.c is the part that both share. */
#ifndef INSTANCE_H
#define INSTANCE_H

#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

enum { OK, WARNING, DISCARD, ERROR, FATAL };
typedef struct Object Object;
typedef struct Instance Instance;
typedef void Emit(const Instance *, int status, const char *category, const char *text);

enum { COSIMULATION_2, COSIMULATION_3, EXCHANGE_3 };
/* States of the state machines of the FMI; those from EVENT on are initialized. FAILED: after an initialization that failed;
   STEP_FAILED: of FMI 2, after a discarded step. */
enum { INSTANTIATED, CONFIGURATION, INITIALIZATION, FAILED, EVENT, CONTINUOUS, STEP, STEP_FAILED, TERMINATED, N_PHASE };
/* Functions by the states they are allowed in. */
enum {
    ALWAYS, SETUP, ENTER_CONFIGURATION, EXIT_CONFIGURATION, ENTER_INITIALIZATION, EXIT_INITIALIZATION, TERMINATE, GET, SET,
    DIFFERENTIATE, DO_STEP, GET_STATUS, ENTER_EVENT, ENTER_CONTINUOUS, UPDATE, SET_CONTINUOUS, INTEGRATED, COUNT_STATES,
    EVALUATE, N_CALL
};

struct Instance {
    Emit *emit;        /* passes a message on in the way of this version of the FMI */
    char *name;
    void *environment; /* of the host */
    void *logger;      /* of the host; its type depends on the version */
    Object *fmu;       /* the instance behind the functions */
    Object *texts;     /* of Python: strings that the host may read until the next call for strings */
    double time;       /* end of the last accepted step, s */
    int early;         /* whether the host lets a step end before its end */
    int last;          /* status of the last step */
    int kind, phase;   /* version and interface; state of their state machine */
};

/* In calls.c: whether a function may be called now, else a message, but for NULL; a status, with which the instance is in
   another state where the call succeeded. */
int allowed(const Instance *, int call, const char *function);
int entered(Instance *, int status, int phase);
#define ALLOWED(call)                                                                                                  \
    if (!allowed(c, call, __func__)) return ERROR

/* A new instance, or NULL after a message; the names are copied. */
Instance *opened(const Instance *given, const char *name, const char *token, const char *resources);
void closed(Instance *);

/* In common.c: a message with its category, a copy of a text, the refusal of a function, a path from a URI. */
void emit(const Instance *, int status, const char *text);
char *copied(const char *text);
int unsupported(Instance *, const char *function);
char *path_of(const char *uri);
extern const char known_file[]; /* in the folder of resources of every FMU of this kind */

/* tolerance: 0 where the host gives none. */
int setup(Instance *, double start, double tolerance);
int initialize(Instance *);
int terminate(Instance *);
int reset(Instance *);
int step(Instance *, double t, double h);

int get_numbers(Instance *, const uint32_t *references, size_t n, double *values, size_t size);
int set_numbers(Instance *, const uint32_t *references, size_t n, const double *values, size_t size);
int get_texts(Instance *, const uint32_t *references, size_t n, const char **values, size_t size);
int set_texts(Instance *, const uint32_t *references, size_t n, const char *const *values, size_t size);
int write_vector(Instance *, const char *method, const double *values, size_t size);
int read_vector(Instance *, const char *method, double *values, size_t size);
int directional_derivative(Instance *, const uint32_t *unknowns, size_t n, const uint32_t *knowns, size_t m,
                           const double *seed, size_t size_of_seed, double *values, size_t size);
int set_time(Instance *, double t);

int get_state(Instance *, void **state);
int set_state(Instance *, void *state);
int free_state(Instance *, void **state);
int state_size(Instance *, void *state, size_t *size);
int state_to_bytes(Instance *, void *state, char *bytes, size_t size);
int state_from_bytes(Instance *, const char *bytes, size_t size, void **state);

#endif
