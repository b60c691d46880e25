/* An instance of a reduced model for Model Exchange: a Python object whose methods are the functions of the FMI. Every call of
   the host is one call of a method. */
#include "interpreter.h"

const char known_file[] = "entry.txt";

static PyThing *of(const Instance *c) { return (PyThing *)c->fmu; }

Instance *opened(const Instance *given, const char *name, const char *token, const char *resources)
{
    Instance *c = malloc(sizeof *c);
    if (c == NULL) return NULL;
    *c = *given;
    c->name = copied(name ? name : "");
    if (c->name == NULL || resources == NULL) {
        emit(c, ERROR, "the host gives no folder of resources");
        closed(c);
        return NULL;
    }
    c->fmu = (Object *)opened_object(c, token, resources);
    if (c->fmu != NULL) return c;
    closed(c);
    return NULL;
}

void closed(Instance *c)
{
    if (c == NULL) return;
    if (c->fmu != NULL) {
        call(c, of(c), "close", "()");
        int state = lock();
        Py_DecRef(of(c));
        Py_DecRef((PyThing *)c->texts);
        unlock(state);
    }
    free(c->name);
    free(c);
}

/* -- variables ----------------------------------------------------------------------------------------------------- */
int get_numbers(Instance *c, const uint32_t *references, size_t n, double *values, size_t size)
{
    if (n == 0) return OK;
    /* the views are made before the call: they need the lock already, which may be taken twice */
    int state = lock();
    int status = call(c, of(c), "get_numbers", "(NN)", readable(references, 4 * n), writable(values, 8 * size));
    unlock(state);
    return status;
}

int set_numbers(Instance *c, const uint32_t *references, size_t n, const double *values, size_t size)
{
    if (n == 0) return OK;
    int state = lock();
    int status = call(c, of(c), "set_numbers", "(NN)", readable(references, 4 * n), readable(values, 8 * size));
    unlock(state);
    return status;
}

int directional_derivative(Instance *c, const uint32_t *unknowns, size_t n, const uint32_t *knowns, size_t m,
                           const double *seed, size_t size_of_seed, double *values, size_t size)
{
    if (n == 0) return OK;
    int state = lock();
    int status = call(c, of(c), "directional_derivative", "(NNNN)", readable(unknowns, 4 * n), readable(knowns, 4 * m),
                      readable(seed, 8 * size_of_seed), writable(values, 8 * size));
    unlock(state);
    return status;
}

int get_texts(Instance *c, const uint32_t *references, size_t n, const char **values, size_t size)
{
    if (n == 0) return OK;
    int state = lock();
    PyThing *texts = PyList_New(0);
    /* O: the list stays ours, the views are given away */
    int status = call(c, of(c), "get_texts", "(NO)", readable(references, 4 * n), texts);
    for (size_t i = 0; i < size && status < DISCARD; i++) {
        PyThing *bytes = PyList_GetItem(texts, (ptrdiff_t)i);
        values[i] = bytes ? PyBytes_AsString(bytes) : "";
    }
    PyErr_Clear();  /* a string less than requested */
    Py_DecRef((PyThing *)c->texts);
    c->texts = (Object *)texts;
    unlock(state);
    return status;
}

int set_texts(Instance *c, const uint32_t *references, size_t n, const char *const *values, size_t size)
{
    if (n == 0) return OK;
    int state = lock();
    PyThing *texts = PyList_New(0);
    for (size_t i = 0; i < size; i++) {
        const char *text = values[i] ? values[i] : "";
        PyThing *bytes = PyBytes_FromStringAndSize(text, (ptrdiff_t)strlen(text));
        PyList_Append(texts, bytes);
        Py_DecRef(bytes);
    }
    int status = call(c, of(c), "set_texts", "(NN)", readable(references, 4 * n), texts);
    unlock(state);
    return status;
}

int read_vector(Instance *c, const char *method, double *values, size_t size)
{
    if (size == 0) return OK;
    int state = lock();
    int status = call(c, of(c), method, "(N)", writable(values, 8 * size));
    unlock(state);
    return status;
}

int write_vector(Instance *c, const char *method, const double *values, size_t size)
{
    if (size == 0) return OK;
    int state = lock();
    int status = call(c, of(c), method, "(N)", readable(values, 8 * size));
    unlock(state);
    return status;
}

/* -- life cycle ---------------------------------------------------------------------------------------------------- */
int setup(Instance *c, double start, double tolerance)
{
    c->time = start;
    return call(c, of(c), "setup", "(dd)", start, tolerance);
}

int initialize(Instance *c) { return call(c, of(c), "initialize", "()"); }
int terminate(Instance *c) { return call(c, of(c), "terminate", "()"); }
int set_time(Instance *c, double t) { return call(c, of(c), "set_time", "(d)", t); }

int reset(Instance *c)
{
    c->time = 0.0;
    c->last = OK;
    return call(c, of(c), "reset", "()");
}

int step(Instance *c, double t, double h) { return (void)t, (void)h, unsupported(c, "doStep"); }

/* -- states: a handle is a number that is never given twice ---------------------------------------------------------- */
int get_state(Instance *c, void **state)
{
    int64_t handle = (int64_t)(intptr_t)*state;
    int locked = lock();
    int status = call(c, of(c), "get_state", "(Ni)", writable(&handle, sizeof handle), c->phase);
    unlock(locked);
    if (status < DISCARD) *state = (void *)(intptr_t)handle;
    return status;
}

int set_state(Instance *c, void *state)
{
    int64_t phase = c->phase;
    int locked = lock();
    int status = call(c, of(c), "set_state", "(LN)", (long long)(intptr_t)state, writable(&phase, sizeof phase));
    unlock(locked);
    return entered(c, status, (int)phase);
}

int free_state(Instance *c, void **state)
{
    if (state == NULL || *state == NULL) return OK;
    int status = call(c, of(c), "free_state", "(L)", (long long)(intptr_t)*state);
    *state = NULL;
    return status;
}

int state_size(Instance *c, void *state, size_t *size)
{
    int64_t count = 0;
    int locked = lock();
    int status = call(c, of(c), "state_size", "(LN)", (long long)(intptr_t)state, writable(&count, sizeof count));
    unlock(locked);
    *size = (size_t)count;
    return status;
}

int state_to_bytes(Instance *c, void *state, char *bytes, size_t size)
{
    int locked = lock();
    int status = call(c, of(c), "state_to_bytes", "(LN)", (long long)(intptr_t)state, writable(bytes, size));
    unlock(locked);
    return status;
}

int state_from_bytes(Instance *c, const char *bytes, size_t size, void **state)
{
    int64_t handle = 0;
    int locked = lock();
    PyThing *copy = PyBytes_FromStringAndSize(bytes, (ptrdiff_t)size);
    int status = call(c, of(c), "state_from_bytes", "(NN)", copy, writable(&handle, sizeof handle));
    unlock(locked);
    *state = (void *)(intptr_t)handle;
    return status;
}
