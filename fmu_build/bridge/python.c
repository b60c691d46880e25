/* An instance as a Python object whose methods are the functions of the FMI, in the interpreter of the process, or else
   in one started here; the functions used of it are all of the stable ABI.

   Every call of the host is one call of a method. The method returns a status of the FMI, and PENDING where messages
   wait. An exception becomes a message and the status Error: the instance lives on. No object of Python is used without
   the lock of the interpreter. */
#include "instance.h"

#include <stdio.h>

#ifdef _WIN32
#define WIN32_LEAN_AND_MEAN
#define NOGDI /* its ERROR is 0 */
#include <windows.h>
#define popen _popen
#define pclose _pclose
#else
#include <dlfcn.h>
#endif

#define FUNCTIONS(F)                                                                                                   \
    F(int, Py_IsInitialized, (void))                                                                                   \
    F(void, Py_InitializeEx, (int))                                                                                    \
    F(void *, PyEval_SaveThread, (void))                                                                               \
    F(int, PyGILState_Ensure, (void))                                                                                  \
    F(void, PyGILState_Release, (int))                                                                                 \
    F(Object *, Py_CompileString, (const char *, const char *, int))                                                   \
    F(Object *, PyImport_ExecCodeModule, (const char *, Object *))                                                     \
    F(Object *, PyObject_GetAttrString, (Object *, const char *))                                                      \
    F(Object *, PyObject_CallObject, (Object *, Object *))                                                             \
    F(Object *, Py_VaBuildValue, (const char *, va_list))                                                              \
    F(Object *, PyObject_Str, (Object *))                                                                              \
    F(Object *, PyUnicode_AsEncodedString, (Object *, const char *, const char *))                                     \
    F(Object *, PyUnicode_DecodeFSDefault, (const char *))                                                             \
    F(Object *, PyBytes_FromStringAndSize, (const char *, ptrdiff_t))                                                  \
    F(char *, PyBytes_AsString, (Object *))                                                                            \
    F(ptrdiff_t, PyBytes_Size, (Object *))                                                                             \
    F(Object *, PyMemoryView_FromMemory, (char *, ptrdiff_t, int))                                                     \
    F(Object *, PyList_New, (ptrdiff_t))                                                                               \
    F(int, PyList_Append, (Object *, Object *))                                                                        \
    F(ptrdiff_t, PyList_Size, (Object *))                                                                              \
    F(Object *, PyList_GetItem, (Object *, ptrdiff_t))                                                                 \
    F(Object *, PyTuple_GetItem, (Object *, ptrdiff_t))                                                                \
    F(long, PyLong_AsLong, (Object *))                                                                                 \
    F(void, PyErr_Fetch, (Object **, Object **, Object **))                                                            \
    F(void, PyErr_NormalizeException, (Object **, Object **, Object **))                                               \
    F(void, PyErr_Clear, (void))                                                                                       \
    F(void, Py_DecRef, (Object *))

#define POINTER(type, name, arguments) static type(*name) arguments;
FUNCTIONS(POINTER)

enum { PENDING = 256 };
const char known_file[] = "entry.txt";

enum { FILE_INPUT = 257, READ = 0x100, WRITE = 0x200 };

/* Run once per instance; the entry names the package beside it and the class of the adapter in it. */
static const char entry[] =
    "import importlib, os, sys\n"
    "def opened(resources, *arguments):\n"
    "    if sys.version_info < (3, 11):\n"
    "        raise ImportError(f'this FMU needs Python 3.11 or newer; here runs {sys.version} in {sys.prefix}')\n"
    "    with open(os.path.join(resources, 'entry.txt'), encoding='utf-8') as file:\n"
    "        package, name = file.read().split()\n"
    "    sys.path.insert(0, resources)\n"
    "    try:\n"
    "        adapter = importlib.import_module(package + '.fmu_build.adapter')\n"
    "    finally:\n"
    "        sys.path.remove(resources)\n"
    "        sys.path_importer_cache.pop(resources, None)\n"
    "    return getattr(adapter, name)(resources, *arguments)\n";

/* Printed by an executable of Python: itself, and its shared library. */
static const char question[] =
    "import os, sys, sysconfig; v = sysconfig.get_config_var; print(sys.executable); "
    "print(os.path.join(sys.base_prefix, 'python%d%d.dll' % sys.version_info[:2]) if os.name == 'nt' else "
    "os.path.join(v('PYTHONFRAMEWORKPREFIX') or v('LIBDIR') or '', "
    "v('LDLIBRARY') if v('PYTHONFRAMEWORK') else v('INSTSONAME') or ''))";

static char trouble[2048]; /* why there is no interpreter */

#ifdef _WIN32
static void *symbol(void *library, const char *name) { return (void *)GetProcAddress((HMODULE)library, name); }

static void *library_of_process(void)
{
    void *library = (void *)GetModuleHandleA("python3.dll");
    char name[32];
    for (int minor = 11; library == NULL && minor < 40; minor++) {
        snprintf(name, sizeof name, "python3%d.dll", minor);
        library = (void *)GetModuleHandleA(name);
    }
    return library;
}

static void *load(const char *path) { return (void *)LoadLibraryExA(path, NULL, LOAD_WITH_ALTERED_SEARCH_PATH); }
#else
static void *symbol(void *library, const char *name) { return dlsym(library, name); }

static void *library_of_process(void)
{
    char name[40];
    if (dlsym(RTLD_DEFAULT, "Py_IsInitialized") != NULL) return dlopen(NULL, RTLD_NOW);
    for (int minor = 11; minor < 40; minor++) { /* loaded by the host for itself alone */
        snprintf(name, sizeof name, "libpython3.%d.so.1.0", minor);
        void *library = dlopen(name, RTLD_NOW | RTLD_GLOBAL | RTLD_NOLOAD);
        if (library != NULL) return library;
    }
    return NULL;
}

/* modules of Python in C find its functions among those of the process */
static void *load(const char *path) { return dlopen(path, RTLD_NOW | RTLD_GLOBAL); }
#endif

static int line_of(FILE *stream, char *line, int size)
{
    if (fgets(line, size, stream) == NULL) return 0;
    line[strcspn(line, "\r\n")] = '\0';
    return line[0] != '\0';
}

/* Executable and library of the Python that LATIN_FMU_PYTHON names, else of python3 on the path of the host. */
static int ask(char *executable, char *library, int size)
{
    const char *chosen = getenv("LATIN_FMU_PYTHON");
#ifdef _WIN32
    const char *python = chosen ? chosen : "python", *quote = "\"";
#else
    const char *python = chosen ? chosen : "python3", *quote = "'";
#endif
    char command[8192];
    snprintf(trouble, sizeof trouble,
             "the host is no Python, and '%s' cannot be run: set LATIN_FMU_PYTHON to the Python (3.11 or newer, with a "
             "shared library) that has the packages this FMU needs; see documentation/externalDependencies.txt",
             python);
    if (strpbrk(python, "'\"\n") != NULL) return 0;  /* they would end the quotation */
    snprintf(command, sizeof command, "%s%s%s -c \"%s\"", quote, python, quote, question);
    FILE *stream = popen(command, "r");
    if (stream == NULL) return 0;
    int good = line_of(stream, executable, size) && line_of(stream, library, size);
    pclose(stream);
    return good;
}

static int bound(void *library)
{
#define BIND(type, name, arguments)                                                                                    \
    *(void **)&name = symbol(library, #name);                                                                          \
    if (name == NULL) {                                                                                                \
        snprintf(trouble, sizeof trouble, "the Python of this process has no function %s", #name);                     \
        return 0;                                                                                                      \
    }
    FUNCTIONS(BIND)
    return 1;
}

static int started(void *library, const char *executable)
{
    typedef wchar_t *Decode(const char *, size_t *);
    typedef void SetName(const wchar_t *);
    Decode *decode = (Decode *)symbol(library, "Py_DecodeLocale");
    SetName *set_name = (SetName *)symbol(library, "Py_SetProgramName");
    if (decode != NULL && set_name != NULL) { /* finds the packages of this Python */
        wchar_t *name = decode(executable, NULL); /* kept: the interpreter points to it */
        if (name != NULL) set_name(name);
    }
    Py_InitializeEx(0);
    PyEval_SaveThread(); /* any thread may call from now on */
    return 1;
}

static int found_python(void)
{
    char executable[4096], path[4096];
    void *library = library_of_process();
    /* a library of Python without an interpreter: one is started in it */
    if (library != NULL && bound(library) && Py_IsInitialized()) return 1;
    if (!ask(executable, path, sizeof path)) return 0;
    if (library == NULL) library = load(path);
    if (library == NULL) {
        snprintf(trouble, sizeof trouble,
                 "the Python %.500s has no shared library that can be loaded (%.900s): set LATIN_FMU_PYTHON to one that "
                 "has, or load its library into the host before",
                 executable, path);
        return 0;
    }
    return bound(library) && started(library, executable);
}

/* Every FMU has a copy of this library, and all of them one interpreter: it is found under a lock of the process. */
static int ready(void)
{
    static int known;
#ifdef _WIN32
    char name[40];
    snprintf(name, sizeof name, "latin_fmu_python_%lu", (unsigned long)GetCurrentProcessId());
    HANDLE mutex = CreateMutexA(NULL, FALSE, name);
    WaitForSingleObject(mutex, INFINITE);
    if (!known) known = found_python();
    ReleaseMutex(mutex);
    CloseHandle(mutex);
#else
    flockfile(stderr); /* a lock that all copies know; another thread that writes there waits */
    if (!known) known = found_python();
    funlockfile(stderr);
#endif
    return known;
}

static int lock(void) { return PyGILState_Ensure(); }
static void unlock(int state) { PyGILState_Release(state); }
static Object *readable(const void *memory, size_t bytes) { return PyMemoryView_FromMemory((char *)memory, (ptrdiff_t)bytes, READ); }
static Object *writable(void *memory, size_t bytes) { return PyMemoryView_FromMemory(memory, (ptrdiff_t)bytes, WRITE); }

/* -- messages ------------------------------------------------------------------------------------------------------ */
static void tell_object(const Instance *c, int status, Object *message)
{
    Object *text = message ? PyObject_Str(message) : NULL;
    Object *bytes = text ? PyUnicode_AsEncodedString(text, "utf-8", "replace") : NULL;
    emit(c, status, bytes ? PyBytes_AsString(bytes) : "an error without text");
    Py_DecRef(bytes);
    Py_DecRef(text);
    PyErr_Clear();
}

static int tell_exception(const Instance *c)
{
    Object *type = NULL, *value = NULL, *trace = NULL;
    PyErr_Fetch(&type, &value, &trace);
    PyErr_NormalizeException(&type, &value, &trace);
    tell_object(c, ERROR, value);
    Py_DecRef(type);
    Py_DecRef(value);
    Py_DecRef(trace);
    return ERROR;
}

static void tell_pending(const Instance *c)
{
    Object *messages = PyObject_GetAttrString(c->fmu, "messages");
    Object *taken = messages ? PyObject_CallObject(messages, NULL) : NULL;
    ptrdiff_t n = taken ? PyList_Size(taken) : 0;
    for (ptrdiff_t i = 0; i < n; i++) {
        Object *pair = PyList_GetItem(taken, i); /* borrowed */
        tell_object(c, (int)PyLong_AsLong(PyTuple_GetItem(pair, 0)), PyTuple_GetItem(pair, 1));
    }
    if (taken == NULL) tell_exception(c);
    Py_DecRef(taken);
    Py_DecRef(messages);
}

/* -- calls --------------------------------------------------------------------------------------------------------- */
static Object *result_of(Object *owner, const char *method, Object *arguments)
{
    Object *function = arguments ? PyObject_GetAttrString(owner, method) : NULL;
    Object *result = function ? PyObject_CallObject(function, arguments) : NULL;
    Py_DecRef(function);
    Py_DecRef(arguments);
    return result;
}

/* Calls a method. format: arguments as for Py_BuildValue, in parentheses; views of memory are given with N. */
static int call(Instance *c, const char *method, const char *format, ...)
{
    va_list given;
    int state = lock();
    va_start(given, format);
    Object *result = result_of(c->fmu, method, Py_VaBuildValue(format, given));
    va_end(given);
    int status = result ? (int)PyLong_AsLong(result) : -1;  /* an exception */
    Py_DecRef(result);
    if (status < 0) status = tell_exception(c);
    if (status & PENDING) tell_pending(c);
    unlock(state);
    return status & ~PENDING;
}

static Object *values(const char *format, ...)
{
    va_list given;
    va_start(given, format);
    Object *made = Py_VaBuildValue(format, given);
    va_end(given);
    return made;
}

static Object *object_of(const Instance *c, const char *token, const char *resources)
{
    Object *code = Py_CompileString(entry, "entry of the FMU", FILE_INPUT);
    Object *module = code ? PyImport_ExecCodeModule("latin_fmu_entry", code) : NULL;
    Object *folder = PyUnicode_DecodeFSDefault(resources);
    Object *arguments = folder ? values("(Oss)", folder, c->name, token ? token : "") : NULL;
    Object *fmu = module && arguments ? result_of(module, "opened", arguments) : NULL;
    Py_DecRef(folder);
    Py_DecRef(module);
    Py_DecRef(code);
    return fmu;
}

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
    if (!ready()) {
        emit(c, ERROR, trouble);
        closed(c);
        return NULL;
    }
    int state = lock();
    c->fmu = object_of(c, token, resources);
    if (c->fmu == NULL) tell_exception(c);
    unlock(state);
    if (c->fmu != NULL) return c;
    closed(c);
    return NULL;
}

void closed(Instance *c)
{
    if (c == NULL) return;
    if (c->fmu != NULL) {
        call(c, "close", "()");
        int state = lock();
        Py_DecRef(c->fmu);
        Py_DecRef(c->texts);
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
    int status = call(c, "get_numbers", "(NN)", readable(references, 4 * n), writable(values, 8 * size));
    unlock(state);
    return status;
}

int set_numbers(Instance *c, const uint32_t *references, size_t n, const double *values, size_t size)
{
    if (n == 0) return OK;
    int state = lock();
    int status = call(c, "set_numbers", "(NN)", readable(references, 4 * n), readable(values, 8 * size));
    unlock(state);
    return status;
}

int directional_derivative(Instance *c, const uint32_t *unknowns, size_t n, const uint32_t *knowns, size_t m,
                           const double *seed, size_t size_of_seed, double *values, size_t size)
{
    if (n == 0) return OK;
    int state = lock();
    int status = call(c, "directional_derivative", "(NNNN)", readable(unknowns, 4 * n), readable(knowns, 4 * m),
                      readable(seed, 8 * size_of_seed), writable(values, 8 * size));
    unlock(state);
    return status;
}

int get_texts(Instance *c, const uint32_t *references, size_t n, const char **values, size_t size)
{
    if (n == 0) return OK;
    int state = lock();
    Object *texts = PyList_New(0);
    /* O: the list stays ours, the views are given away */
    int status = call(c, "get_texts", "(NO)", readable(references, 4 * n), texts);
    for (size_t i = 0; i < size && status < DISCARD; i++) {
        Object *bytes = PyList_GetItem(texts, (ptrdiff_t)i);
        values[i] = bytes ? PyBytes_AsString(bytes) : "";
    }
    PyErr_Clear();  /* a string less than requested */
    Py_DecRef(c->texts);
    c->texts = texts;
    unlock(state);
    return status;
}

int set_texts(Instance *c, const uint32_t *references, size_t n, const char *const *values, size_t size)
{
    if (n == 0) return OK;
    int state = lock();
    Object *texts = PyList_New(0);
    for (size_t i = 0; i < size; i++) {
        const char *text = values[i] ? values[i] : "";
        Object *bytes = PyBytes_FromStringAndSize(text, (ptrdiff_t)strlen(text));
        PyList_Append(texts, bytes);
        Py_DecRef(bytes);
    }
    int status = call(c, "set_texts", "(NN)", readable(references, 4 * n), texts);
    unlock(state);
    return status;
}

int read_vector(Instance *c, const char *method, double *values, size_t size)
{
    if (size == 0) return OK;
    int state = lock();
    int status = call(c, method, "(N)", writable(values, 8 * size));
    unlock(state);
    return status;
}

int write_vector(Instance *c, const char *method, const double *values, size_t size)
{
    if (size == 0) return OK;
    int state = lock();
    int status = call(c, method, "(N)", readable(values, 8 * size));
    unlock(state);
    return status;
}

/* -- life cycle ---------------------------------------------------------------------------------------------------- */
int setup(Instance *c, double start, double tolerance)
{
    c->time = start;
    return call(c, "setup", "(dd)", start, tolerance);
}

int initialize(Instance *c) { return call(c, "initialize", "()"); }
int terminate(Instance *c) { return call(c, "terminate", "()"); }
int set_time(Instance *c, double t) { return call(c, "set_time", "(d)", t); }

int reset(Instance *c)
{
    c->time = 0.0;
    c->last = OK;
    return call(c, "reset", "()");
}

int step(Instance *c, double t, double h)
{
    double end = t + h;
    if (c->early) {
        int state = lock();
        c->last = call(c, "step_early", "(ddN)", t, h, writable(&end, sizeof end));
        unlock(state);
    } else {
        c->last = call(c, "step", "(dd)", t, h);
    }
    if (c->last < DISCARD) c->time = end;
    return c->last;
}

/* -- states: a handle is a number that is never given twice ---------------------------------------------------------- */
int get_state(Instance *c, void **state)
{
    int64_t handle = (int64_t)(intptr_t)*state;
    int locked = lock();
    int status = call(c, "get_state", "(Ni)", writable(&handle, sizeof handle), c->phase);
    unlock(locked);
    if (status < DISCARD) *state = (void *)(intptr_t)handle;
    return status;
}

int set_state(Instance *c, void *state)
{
    int64_t phase = c->phase;
    int locked = lock();
    int status = call(c, "set_state", "(LN)", (long long)(intptr_t)state, writable(&phase, sizeof phase));
    unlock(locked);
    return entered(c, status, (int)phase);
}

int free_state(Instance *c, void **state)
{
    if (state == NULL || *state == NULL) return OK;
    int status = call(c, "free_state", "(L)", (long long)(intptr_t)*state);
    *state = NULL;
    return status;
}

int state_size(Instance *c, void *state, size_t *size)
{
    int64_t count = 0;
    int locked = lock();
    int status = call(c, "state_size", "(LN)", (long long)(intptr_t)state, writable(&count, sizeof count));
    unlock(locked);
    *size = (size_t)count;
    return status;
}

int state_to_bytes(Instance *c, void *state, char *bytes, size_t size)
{
    int locked = lock();
    int status = call(c, "state_to_bytes", "(LN)", (long long)(intptr_t)state, writable(bytes, size));
    unlock(locked);
    return status;
}

int state_from_bytes(Instance *c, const char *bytes, size_t size, void **state)
{
    int64_t handle = 0;
    int locked = lock();
    Object *copy = PyBytes_FromStringAndSize(bytes, (ptrdiff_t)size);
    int status = call(c, "state_from_bytes", "(NN)", copy, writable(&handle, sizeof handle));
    unlock(locked);
    *state = (void *)(intptr_t)handle;
    return status;
}
