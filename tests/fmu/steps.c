/* A host that is no Python: makes the steps that it reads, through an FMU of FMI 2.

   steps LIBRARY RESOURCES GUID INPUTS OUTPUTS < lines
   INPUTS, OUTPUTS: references of real variables, with commas between. First line: inputs at the start; then a step each:
   its length, s, and the inputs. "back" before a line: the step is made with twice the inputs, taken back through a
   serialized state, and made as it stands. It prints the outputs of the start and of each step, to the last bit, and to
   stderr the time from instantiation to the end of the first step and the median of a step, s.
   Exit: 0 where every call was good, else 10 + status. */
#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "print.h"

enum { MOST = 256, STEPS = 1000000 };
typedef void *Instance;

static struct {
    void (*logger)(void *, const char *, int, const char *, const char *, ...);
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void *finished, *environment;
} callbacks = {print, calloc, free, NULL, NULL};

#define FUNCTIONS(F)                                                                                                   \
    F(Instance, Instantiate, (const char *, int, const char *, const char *, const void *, int, int))                 \
    F(void, FreeInstance, (Instance))                                                                                  \
    F(int, SetupExperiment, (Instance, int, double, double, int, double))                                              \
    F(int, EnterInitializationMode, (Instance))                                                                        \
    F(int, ExitInitializationMode, (Instance))                                                                         \
    F(int, SetReal, (Instance, const unsigned *, size_t, const double *))                                              \
    F(int, GetReal, (Instance, const unsigned *, size_t, double *))                                                    \
    F(int, DoStep, (Instance, double, double, int))                                                                    \
    F(int, GetFMUstate, (Instance, void **))                                                                           \
    F(int, SetFMUstate, (Instance, void *))                                                                            \
    F(int, FreeFMUstate, (Instance, void **))                                                                          \
    F(int, SerializedFMUstateSize, (Instance, void *, size_t *))                                                       \
    F(int, SerializeFMUstate, (Instance, void *, char *, size_t))                                                      \
    F(int, DeSerializeFMUstate, (Instance, const char *, size_t, void **))                                             \
    F(int, Terminate, (Instance))
#define POINTER(type, name, arguments) static type(*name) arguments;
FUNCTIONS(POINTER)
#define BIND(type, name, arguments) name = (type(*) arguments)dlsym(library, "fmi2" #name);

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
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static int larger(const void *a, const void *b) { return *(const double *)a > *(const double *)b ? 1 : -1; }

static int write_outputs(Instance c, const unsigned *outputs, int n)
{
    double values[MOST];
    TRY(GetReal(c, outputs, (size_t)n, values));
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
    TRY(SetReal(c, inputs, (size_t)n, other));
    TRY(DoStep(c, t, h, 0));
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
    FUNCTIONS(BIND)
    int n_input = references(given[4], inputs), n_output = references(given[5], outputs), n_step = 0;
    double begin = now();
    Instance c = Instantiate("one", 1, given[3], given[2], &callbacks, 0, 0);
    if (c == NULL) return 3;
    for (int i = 0; i < n_input; i++)
        if (scanf("%lf", values + i) != 1) return 2;
    TRY(SetupExperiment(c, 0, 0.0, 0.0, 0, 0.0));
    TRY(EnterInitializationMode(c));
    TRY(SetReal(c, inputs, (size_t)n_input, values));
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
        TRY(SetReal(c, inputs, (size_t)n_input, values));
        TRY(DoStep(c, t, h, 1));
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
