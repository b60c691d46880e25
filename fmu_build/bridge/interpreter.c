/* Finds the interpreter of Python of the process, or starts one; calls of its objects. Every FMU has a copy of this. */
#include "interpreter.h"

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

#define POINTER(type, name, arguments) type(*name) arguments;
FUNCTIONS(POINTER)

enum { PENDING = 256 };

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

char python_trouble[2048];

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
static int query(char *executable, char *library, int size)
{
    const char *chosen = getenv("LATIN_FMU_PYTHON");
#ifdef _WIN32
    const char *python = chosen ? chosen : "python", *quote = "\"";
#else
    const char *python = chosen ? chosen : "python3", *quote = "'";
#endif
    char command[8192];
    snprintf(python_trouble, sizeof python_trouble,
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
        snprintf(python_trouble, sizeof python_trouble, "the Python of this process has no function %s", #name);                     \
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
    if (!query(executable, path, sizeof path)) return 0;
    if (library == NULL) library = load(path);
    if (library == NULL) {
        snprintf(python_trouble, sizeof python_trouble,
                 "the Python %.500s has no shared library that can be loaded (%.900s): set LATIN_FMU_PYTHON to one that "
                 "has, or load its library into the host before",
                 executable, path);
        return 0;
    }
    return bound(library) && started(library, executable);
}

/* Every FMU has a copy of this library, and all of them one interpreter: it is found under a lock of the process. */
int python_ready(void)
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

int lock(void) { return PyGILState_Ensure(); }
void unlock(int state) { PyGILState_Release(state); }
PyThing *readable(const void *memory, size_t bytes) { return PyMemoryView_FromMemory((char *)memory, (ptrdiff_t)bytes, READ); }
PyThing *writable(void *memory, size_t bytes) { return PyMemoryView_FromMemory(memory, (ptrdiff_t)bytes, WRITE); }

/* -- messages ------------------------------------------------------------------------------------------------------ */
static void tell_object(const Instance *c, int status, PyThing *message)
{
    PyThing *text = message ? PyObject_Str(message) : NULL;
    PyThing *bytes = text ? PyUnicode_AsEncodedString(text, "utf-8", "replace") : NULL;
    emit(c, status, bytes ? PyBytes_AsString(bytes) : "an error without text");
    Py_DecRef(bytes);
    Py_DecRef(text);
    PyErr_Clear();
}

static int tell_exception(const Instance *c)
{
    PyThing *type = NULL, *value = NULL, *trace = NULL;
    PyErr_Fetch(&type, &value, &trace);
    PyErr_NormalizeException(&type, &value, &trace);
    tell_object(c, ERROR, value);
    Py_DecRef(type);
    Py_DecRef(value);
    Py_DecRef(trace);
    return ERROR;
}

static void tell_pending(const Instance *c, PyThing *owner)
{
    PyThing *messages = PyObject_GetAttrString(owner, "messages");
    PyThing *taken = messages ? PyObject_CallObject(messages, NULL) : NULL;
    ptrdiff_t n = taken ? PyList_Size(taken) : 0;
    for (ptrdiff_t i = 0; i < n; i++) {
        PyThing *pair = PyList_GetItem(taken, i); /* borrowed */
        tell_object(c, (int)PyLong_AsLong(PyTuple_GetItem(pair, 0)), PyTuple_GetItem(pair, 1));
    }
    if (taken == NULL) tell_exception(c);
    Py_DecRef(taken);
    Py_DecRef(messages);
}

/* -- calls --------------------------------------------------------------------------------------------------------- */
static PyThing *result_of(PyThing *owner, const char *method, PyThing *arguments)
{
    PyThing *function = arguments ? PyObject_GetAttrString(owner, method) : NULL;
    PyThing *result = function ? PyObject_CallObject(function, arguments) : NULL;
    Py_DecRef(function);
    Py_DecRef(arguments);
    return result;
}

int call(const Instance *c, PyThing *owner, const char *method, const char *format, ...)
{
    va_list given;
    int state = lock();
    va_start(given, format);
    PyThing *result = result_of(owner, method, Py_VaBuildValue(format, given));
    va_end(given);
    int status = result ? (int)PyLong_AsLong(result) : -1;  /* an exception */
    Py_DecRef(result);
    if (status < 0) status = tell_exception(c);
    if (status & PENDING) tell_pending(c, owner);
    unlock(state);
    return status & ~PENDING;
}

static PyThing *values(const char *format, ...)
{
    va_list given;
    va_start(given, format);
    PyThing *made = Py_VaBuildValue(format, given);
    va_end(given);
    return made;
}

PyThing *opened_object(const Instance *c, const char *token, const char *resources)
{
    if (!python_ready()) {
        emit(c, ERROR, python_trouble);
        return NULL;
    }
    int state = lock();
    PyThing *code = Py_CompileString(entry, "entry of the FMU", FILE_INPUT);
    PyThing *module = code ? PyImport_ExecCodeModule("latin_fmu_entry", code) : NULL;
    PyThing *folder = PyUnicode_DecodeFSDefault(resources);
    PyThing *arguments = folder ? values("(Oss)", folder, c->name, token ? token : "") : NULL;
    PyThing *fmu = module && arguments ? result_of(module, "opened", arguments) : NULL;
    if (fmu == NULL) tell_exception(c);
    Py_DecRef(folder);
    Py_DecRef(module);
    Py_DecRef(code);
    unlock(state);
    return fmu;
}
