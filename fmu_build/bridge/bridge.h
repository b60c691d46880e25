/* One instance of an FMU: a Python object whose methods are the functions of the FMI, and the logger of the host.

   Every call of the host is one call of a method. The method returns a status of the FMI, and PENDING where messages
   wait. An exception becomes a message and the status Error: the instance lives on. */
#ifndef BRIDGE_H
#define BRIDGE_H

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
enum { PENDING = 256 };

typedef struct Object Object;
typedef struct Instance Instance;
typedef void Tell(const Instance *, int status, const char *category, const char *text);

struct Instance {
    Tell *tell;        /* passes a message on in the way of this version of the FMI */
    char *name;
    void *environment; /* of the host */
    void *logger;      /* of the host; its type depends on the version */
    Object *fmu;       /* None of Python's objects is used without the lock of the interpreter */
    Object *texts;     /* list of bytes: strings that the host may read until the next call for strings */
    double time;       /* end of the last accepted step, s */
    int early;         /* whether the host lets a step end before its end */
    int last;          /* status of the last step */
};

/* A new instance, or NULL after a message. kind: "2", "3" or "exchange"; the names are copied. */
Instance *opened(const Instance *given, const char *kind, const char *name, const char *token, const char *resources);
void closed(Instance *);

/* Calls a method. format: arguments as for Py_BuildValue, in parentheses; views of memory are given with N. */
int call(Instance *, const char *method, const char *format, ...);
Object *readable(const void *, size_t bytes);
Object *writable(void *, size_t bytes);
int lock(void);
void unlock(int);

int get_numbers(Instance *, const uint32_t *references, size_t n, double *values, size_t size);
int set_numbers(Instance *, const uint32_t *references, size_t n, const double *values, size_t size);
int get_texts(Instance *, const uint32_t *references, size_t n, const char **values, size_t size);
int set_texts(Instance *, const uint32_t *references, size_t n, const char *const *values, size_t size);
int write_vector(Instance *, const char *method, const double *values, size_t size);
int read_vector(Instance *, const char *method, double *values, size_t size);
int directional_derivative(Instance *, const uint32_t *unknowns, size_t n, const uint32_t *knowns, size_t m,
                           const double *seed, size_t size_of_seed, double *values, size_t size);
int step(Instance *, double t, double h);
int unsupported(Instance *, const char *function);

int get_state(Instance *, void **state);
int set_state(Instance *, void *state);
int free_state(Instance *, void **state);
int state_size(Instance *, void *state, size_t *size);
int state_to_bytes(Instance *, void *state, char *bytes, size_t size);
int state_from_bytes(Instance *, const char *bytes, size_t size, void **state);

#endif
