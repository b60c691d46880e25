/* The interpreter of Python in the process of the host: that which is there, else one that is started here. All functions used
   of it are of the stable ABI. No object of Python is used without the lock. */
#ifndef INTERPRETER_H
#define INTERPRETER_H

#include "instance.h"

typedef struct PyThing PyThing; /* an object of Python */

#define FUNCTIONS(F)                                                                                                   \
    F(int, Py_IsInitialized, (void))                                                                                   \
    F(void, Py_InitializeEx, (int))                                                                                    \
    F(void *, PyEval_SaveThread, (void))                                                                               \
    F(int, PyGILState_Ensure, (void))                                                                                  \
    F(void, PyGILState_Release, (int))                                                                                 \
    F(PyThing *, Py_CompileString, (const char *, const char *, int))                                                   \
    F(PyThing *, PyImport_ExecCodeModule, (const char *, PyThing *))                                                     \
    F(PyThing *, PyObject_GetAttrString, (PyThing *, const char *))                                                      \
    F(PyThing *, PyObject_CallObject, (PyThing *, PyThing *))                                                             \
    F(PyThing *, Py_VaBuildValue, (const char *, va_list))                                                              \
    F(PyThing *, PyObject_Str, (PyThing *))                                                                              \
    F(PyThing *, PyUnicode_AsEncodedString, (PyThing *, const char *, const char *))                                     \
    F(PyThing *, PyUnicode_DecodeFSDefault, (const char *))                                                             \
    F(PyThing *, PyBytes_FromStringAndSize, (const char *, ptrdiff_t))                                                  \
    F(char *, PyBytes_AsString, (PyThing *))                                                                            \
    F(ptrdiff_t, PyBytes_Size, (PyThing *))                                                                             \
    F(PyThing *, PyMemoryView_FromMemory, (char *, ptrdiff_t, int))                                                     \
    F(PyThing *, PyList_New, (ptrdiff_t))                                                                               \
    F(int, PyList_Append, (PyThing *, PyThing *))                                                                        \
    F(ptrdiff_t, PyList_Size, (PyThing *))                                                                              \
    F(PyThing *, PyList_GetItem, (PyThing *, ptrdiff_t))                                                                 \
    F(PyThing *, PyTuple_GetItem, (PyThing *, ptrdiff_t))                                                                \
    F(long, PyLong_AsLong, (PyThing *))                                                                                 \
    F(void, PyErr_Fetch, (PyThing **, PyThing **, PyThing **))                                                            \
    F(void, PyErr_NormalizeException, (PyThing **, PyThing **, PyThing **))                                               \
    F(void, PyErr_Clear, (void))                                                                                       \
    F(void, Py_DecRef, (PyThing *))

#define DECLARED(type, name, arguments) extern type(*name) arguments;
FUNCTIONS(DECLARED)

extern char python_trouble[2048]; /* why there is no interpreter */
int python_ready(void);           /* whether there is one */
int lock(void);
void unlock(int state);
PyThing *readable(const void *memory, size_t bytes); /* views of memory */
PyThing *writable(void *memory, size_t bytes);

/* The object that takes the calls: the class that entry.txt in the resources names, opened with these; NULL after a message. */
PyThing *opened_object(const Instance *, const char *token, const char *resources);

/* Calls a method, which returns a status of the FMI, and PENDING where messages wait. format: arguments as for Py_BuildValue,
   in parentheses; views of memory are given with N. An exception becomes a message and the status Error. */
int call(const Instance *, PyThing *owner, const char *method, const char *format, ...);

#endif
