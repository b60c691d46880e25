/* A host that is no Python, for Linux, macOS and Windows: makes the steps that it reads, through an FMU of FMI 2 or 3.

   steps LIBRARY RESOURCES GUID INPUTS OUTPUTS < lines
   RESOURCES: a URI for FMI 2, a path for FMI 3.
   INPUTS, OUTPUTS: references of real variables, with commas between. First line: inputs at the start; then a step each:
   its length, s, and the inputs. "back" before a line: the step is made with twice the inputs, taken back through a
   serialized state, and made as it stands. It prints the outputs of the start and of each step, to the last bit, and to
   stderr the time from instantiation to the end of the first step and the median of a step, s.
   Exit: 0 where every call was good, else 10 + status. */
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "print.h"

#ifdef _WIN32
#include <windows.h>
#define dlopen(path, how) ((void *)LoadLibraryA(path))
#define dlsym(library, name) ((void *)GetProcAddress((HMODULE)(library), name))
#define dlclose(library) FreeLibrary((HMODULE)(library))
#define dlerror() "the library cannot be loaded"
#else
#include <dlfcn.h>
#endif

enum { MOST = 256, STEPS = 1000000 };
typedef void *Instance;

static struct {
    void (*logger)(void *, const char *, int, const char *, const char *, ...);
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void *finished, *environment;
} callbacks = {print, calloc, free, NULL, NULL};

static void print3(void *e, int status, const char *category, const char *text) { print(e, "", status, category, "%s", text); }

#define OF_BOTH(F)                                                                                                     \
    F(void, FreeInstance, (Instance))                                                                                  \
    F(int, ExitInitializationMode, (Instance))                                                                         \
    F(int, GetFMUstate, (Instance, void **))                                                                           \
    F(int, SetFMUstate, (Instance, void *))                                                                            \
    F(int, FreeFMUstate, (Instance, void **))                                                                          \
    F(int, SerializedFMUstateSize, (Instance, void *, size_t *))                                                       \
    F(int, SerializeFMUstate, (Instance, void *, char *, size_t))                                                      \
    F(int, DeSerializeFMUstate, (Instance, const char *, size_t, void **))                                             \
    F(int, Terminate, (Instance))
#define OF_2(F)                                                                                                        \
    F(Instance, Instantiate, (const char *, int, const char *, const char *, const void *, int, int))                 \
    F(int, SetupExperiment, (Instance, int, double, double, int, double))                                              \
    F(int, EnterInitializationMode, (Instance))                                                                        \
    F(int, SetReal, (Instance, const unsigned *, size_t, const double *))                                              \
    F(int, GetReal, (Instance, const unsigned *, size_t, double *))                                                    \
    F(int, DoStep, (Instance, double, double, int))
#define OF_3(F)                                                                                                        \
    F(Instance, InstantiateCoSimulation, (const char *, const char *, const char *, bool, bool, bool, bool,           \
      const unsigned *, size_t, void *, void (*)(void *, int, const char *, const char *), void *))                    \
    F(int, EnterInitializationMode, (Instance, bool, double, double, bool, double))                                    \
    F(int, SetFloat64, (Instance, const unsigned *, size_t, const double *, size_t))                                   \
    F(int, GetFloat64, (Instance, const unsigned *, size_t, double *, size_t))                                         \
    F(int, DoStep, (Instance, double, double, bool, bool *, bool *, bool *, double *))
#define POINTER(type, name, arguments) type(*name) arguments;
#define STATIC_POINTER(type, name, arguments) static type(*name) arguments;
OF_BOTH(STATIC_POINTER)
static struct { OF_2(POINTER) } two;
static struct { OF_3(POINTER) } three;
static int version;

/* A function by its name in FMI 2. */
static void *function(void *library, const char *name)
{
    char full[64];
    snprintf(full, sizeof full, "fmi%d%s", version, name);
    char *state = strstr(full, "FMUstate");
    if (version == 3 && state != NULL) state[3] = 'S';
    if (version == 3 && strncmp(full + 4, "DeS", 3) == 0) full[6] = 's';
    return dlsym(library, full);
}

#define BIND(type, name, arguments) name = (type(*) arguments)function(library, #name);
#define BIND_2(type, name, arguments) two.name = (type(*) arguments)function(library, #name);
#define BIND_3(type, name, arguments) three.name = (type(*) arguments)function(library, #name);

static Instance made(void *library, const char *token, const char *resources)
{
    version = strncmp(resources, "file:", 5) == 0 ? 2 : 3; /* the library of a compiled FMU has the functions of both */
    OF_BOTH(BIND)
    if (version == 2) {
        OF_2(BIND_2)
        return two.Instantiate("one", 1, token, resources, &callbacks, 0, 0);
    }
    OF_3(BIND_3)
    return three.InstantiateCoSimulation("one", token, resources, 0, 0, 0, 0, NULL, 0, NULL, print3, NULL);
}

static int enter(Instance c)
{
    if (version == 3) return three.EnterInitializationMode(c, 0, 0.0, 0.0, 0, 0.0);
    int status = two.SetupExperiment(c, 0, 0.0, 0.0, 0, 0.0);
    return status > 1 ? status : two.EnterInitializationMode(c);
}

static int set(Instance c, const unsigned *inputs, size_t n, const double *values)
{
    return version == 3 ? three.SetFloat64(c, inputs, n, values, n) : two.SetReal(c, inputs, n, values);
}

static int get(Instance c, const unsigned *outputs, size_t n, double *values)
{
    return version == 3 ? three.GetFloat64(c, outputs, n, values, n) : two.GetReal(c, outputs, n, values);
}

static int do_step(Instance c, double t, double h, int final)
{
    bool event, ended, early;
    double last;
    if (version == 2) return two.DoStep(c, t, h, final);
    return three.DoStep(c, t, h, final != 0, &event, &ended, &early, &last);
}

#define TRY(what)                                                                                                      \
    do {                                                                                                               \
        int status = what;                                                                                             \
        if (status > 1) {                                                                                              \
            fprintf(stderr, "%s: status %d\n", #what, status);                                                          \
            return 10 + status;                                                                                        \
        }                                                                                                              \
    } while (0)

static int references(char *text, unsigned *to)
{
    int n = 0;
    for (char *word = strtok(text, ","); word != NULL && n < MOST; word = strtok(NULL, ",")) to[n++] = (unsigned)atoi(word);
    return n;
}

static double now(void)
{
    struct timespec t;
    timespec_get(&t, TIME_UTC);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static int larger(const void *a, const void *b) { return *(const double *)a > *(const double *)b ? 1 : -1; }

static int write_outputs(Instance c, const unsigned *outputs, int n)
{
    double values[MOST];
    TRY(get(c, outputs, (size_t)n, values));
    for (int i = 0; i < n; i++) printf("%a%c", values[i], i < n - 1 ? ' ' : '\n');
    return 0;
}

/* The step with other inputs, taken back. */
static int stray(Instance c, double t, double h, const unsigned *inputs, const double *values, int n)
{
    double other[MOST];
    void *state = NULL, *copy = NULL;
    size_t size;
    for (int i = 0; i < n; i++) other[i] = 2.0 * values[i];
    TRY(GetFMUstate(c, &state));
    TRY(SerializedFMUstateSize(c, state, &size));
    char *bytes = malloc(size + 1); /* at an odd address */
    TRY(SerializeFMUstate(c, state, bytes + 1, size));
    TRY(FreeFMUstate(c, &state));
    TRY(set(c, inputs, (size_t)n, other));
    TRY(do_step(c, t, h, 0));
    TRY(DeSerializeFMUstate(c, bytes + 1, size, &copy));
    TRY(SetFMUstate(c, copy));
    TRY(FreeFMUstate(c, &copy));
    free(bytes);
    return 0;
}

int main(int n, char **given)
{
    unsigned inputs[MOST], outputs[MOST];
    double values[MOST], t = 0.0, h, *spent = malloc(STEPS * sizeof *spent), first = 0.0;
    void *library = n > 5 ? dlopen(given[1], RTLD_NOW | RTLD_LOCAL) : NULL;
    if (library == NULL) return fprintf(stderr, "%s\n", n > 5 ? dlerror() : "arguments"), 2;
    int n_input = references(given[4], inputs), n_output = references(given[5], outputs), n_step = 0;
    double begin = now();
    Instance c = made(library, given[3], given[2]);
    if (c == NULL) return 3;
    for (int i = 0; i < n_input; i++)
        if (scanf("%lf", values + i) != 1) return 2;
    TRY(enter(c));
    TRY(set(c, inputs, (size_t)n_input, values));
    TRY(ExitInitializationMode(c));
    int code = write_outputs(c, outputs, n_output);
    char word[64];
    while (code == 0 && n_step < STEPS && scanf("%63s", word) == 1) {
        int back = strcmp(word, "back") == 0;
        if (back && scanf("%63s", word) != 1) return 2;
        h = atof(word);
        for (int i = 0; i < n_input; i++)
            if (scanf("%lf", values + i) != 1) return 2;
        if (back && (code = stray(c, t, h, inputs, values, n_input)) != 0) return code;
        double start = now();
        TRY(set(c, inputs, (size_t)n_input, values));
        TRY(do_step(c, t, h, 1));
        spent[n_step] = now() - start;
        if (n_step++ == 0) first = now() - begin;
        t += h;
        code = write_outputs(c, outputs, n_output);
    }
    TRY(Terminate(c));
    FreeInstance(c);
    qsort(spent, (size_t)n_step, sizeof *spent, larger);
    fprintf(stderr, "%g %g\n", first, n_step ? spent[n_step / 2] : 0.0);
    free(spent);
    dlclose(library);
    return code;
}
