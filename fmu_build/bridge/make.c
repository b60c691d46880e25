/* An instance of an FMU with Python: the runtime makes its steps, Python the image of the run when a simulation begins, for the
   parameters and start values that are set then (fmu_build/adapter.py). */
#include "interpreter.h"
#include "runtime.h"

int filled_from_files(Instance *c, const char *token, const char *resources)
{
    char trouble[1200];
    const Image *image = image_of_table(resources, token, trouble, sizeof trouble);
    if (image == NULL) return msg(c, ERROR, "%s", trouble), 0;
    if (!filled(c, image)) return 0;
    return (c->fmu->maker = opened_object(c, token, resources)) != NULL;
}

int make_image(Instance *c, const double *numbers, const double *starts)
{
    struct Object *o = c->fmu;
    size_t n_variable = (size_t)table_of(c)[T_N_VARIABLE].i, n_input = (size_t)table_of(c)[T_N_INPUT].i;
    int64_t address = 0;
    /* the views are made before the call: they need the lock already, which may be taken twice */
    int state = lock();
    PyThing *given[] = {readable(numbers, 8 * n_variable), readable(starts, 8 * n_input), writable(&address, sizeof address)};
    int status = call(c, o->maker, "make", "(NNdN)", given[0], given[1], o->accuracy, given[2]);
    unlock(state);
    if (status >= DISCARD) return ERROR;
    const Process *process = (const Process *)(intptr_t)address;
    if (process == o->image->process) return OK; /* it is that already */
    if (!take_image(c, image_in_memory(process, o->image))) return ERROR;
    o->n_row = o->n_fields = 0;
    return OK;
}

char *table_of_file(Instance *c, const char *path)
{
    int state = lock();
    PyThing *rows = PyList_New(0), *name = PyBytes_FromStringAndSize(path, (ptrdiff_t)strlen(path));
    /* O: the list stays ours, the name is given away */
    int status = call(c, c->fmu->maker, "table_of_file", "(NO)", name, rows);
    PyThing *text = status < DISCARD ? PyList_GetItem(rows, 0) : NULL;
    char *copy = text ? copied(PyBytes_AsString(text)) : NULL;
    PyErr_Clear();
    Py_DecRef(rows);
    unlock(state);
    if (copy == NULL && status < DISCARD) msg(c, ERROR, "no memory for the table of %.500s", path);
    return copy;
}

void free_maker(struct Object *o)
{
    if (o->maker == NULL) return;
    int state = lock();
    PyThing *closed = PyObject_GetAttrString(o->maker, "close"), *done = closed ? PyObject_CallObject(closed, NULL) : NULL;
    PyErr_Clear();
    Py_DecRef(done);
    Py_DecRef(closed);
    Py_DecRef(o->maker);
    unlock(state);
    o->maker = NULL;
}
