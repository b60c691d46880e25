/* A host that is no Python: opens FMUs of FMI 2, sets a load, makes steps, frees.

   host CYCLES END STEP LOAD TEXT (LIBRARY RESOURCES GUID REFERENCE TEXT_REFERENCE)...
   CYCLES 0: each FMU once in a thread of its own, all at the same time.
   LOAD: value of the real variable REFERENCE. TEXT: of the string TEXT_REFERENCE, "-" for none; with a text mode = 1.
   Exit: 0 where every call of every cycle was good, else 10 + status. It prints its resident memory, kB, per 50 cycles. */
#include <dlfcn.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "print.h"

typedef void *Instance;
typedef struct {
    void (*logger)(void *, const char *, int, const char *, const char *, ...);
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void *finished, *environment;
} Callbacks;

static long resident(void)
{
    long pages = 0, own = 0;
    FILE *file = fopen("/proc/self/statm", "r");
    if (file != NULL && fscanf(file, "%ld %ld", &pages, &own) != 2) own = 0;
    if (file != NULL) fclose(file);
    return 4 * own;
}

#define GET(type, name, arguments) type(*name) arguments = (type(*) arguments)dlsym(library, "fmi2" #name)
#define TRY(what)                                                                                                      \
    do {                                                                                                               \
        int status = what;                                                                                             \
        if (status > 1) {                                                                                              \
            int ended = 0;                                                                                             \
            if (status == 2) GetBooleanStatus(c, 3, &ended);                                                           \
            fprintf(stderr, "%s: status %d, terminated %d\n", #what, status, ended);                                    \
            FreeInstance(c);                                                                                           \
            return ended ? 0 : 10 + status;                                                                            \
        }                                                                                                              \
    } while (0)

static int run(char **fmu, double end, double h, double load, const char *text)
{
    Callbacks callbacks = {print, calloc, free, NULL, NULL};
    void *library = dlopen(fmu[0], RTLD_NOW | RTLD_LOCAL);
    if (library == NULL) return fprintf(stderr, "%s\n", dlerror()), 2;
    GET(Instance, Instantiate, (const char *, int, const char *, const char *, const Callbacks *, int, int));
    GET(void, FreeInstance, (Instance));
    GET(int, SetupExperiment, (Instance, int, double, double, int, double));
    GET(int, EnterInitializationMode, (Instance));
    GET(int, ExitInitializationMode, (Instance));
    GET(int, SetReal, (Instance, const unsigned *, size_t, const double *));
    GET(int, SetInteger, (Instance, const unsigned *, size_t, const int *));
    GET(int, SetString, (Instance, const unsigned *, size_t, const char *const *));
    GET(int, DoStep, (Instance, double, double, int));
    GET(int, GetBooleanStatus, (Instance, int, int *));
    GET(int, Terminate, (Instance));
    unsigned real = (unsigned)atoi(fmu[3]), string = (unsigned)atoi(fmu[4]), mode = 1;
    const int prescribed = 1;
    Instance c = Instantiate("one", 1, fmu[2], fmu[1], &callbacks, 0, 0);
    if (c == NULL) return 3;
    TRY(SetupExperiment(c, 0, 0.0, 0.0, 0, 0.0));
    TRY(EnterInitializationMode(c));
    TRY(SetReal(c, &real, 1, &load));
    if (strcmp(text, "-") != 0) {
        TRY(SetInteger(c, &mode, 1, &prescribed));
        TRY(SetString(c, &string, 1, &text));
    }
    TRY(ExitInitializationMode(c));
    for (double t = 0.0; t < end - 0.5 * h; t += h) TRY(DoStep(c, t, h, 1));
    TRY(Terminate(c));
    FreeInstance(c);
    dlclose(library);
    return 0;
}

enum { MOST = 16 };
static char **all;
static int codes[MOST];
static pthread_barrier_t gate;

static void *work(void *number)
{
    long i = (long)number;
    pthread_barrier_wait(&gate);
    codes[i] = run(all + 6 + 5 * i, atof(all[2]), atof(all[3]), strtod(all[4], NULL), all[5]);
    return NULL;
}

static int together(int count)
{
    pthread_t threads[MOST];
    int code = 0;
    pthread_barrier_init(&gate, NULL, (unsigned)count);
    for (long i = 0; i < count; i++) pthread_create(threads + i, NULL, work, (void *)i);
    for (int i = 0; i < count; i++) {
        pthread_join(threads[i], NULL);
        if (codes[i]) code = codes[i];
    }
    return code;
}

int main(int n, char **given)
{
    int cycles = atoi(given[1]), count = (n - 6) / 5;
    all = given;
    if (cycles == 0) return together(count < MOST ? count : MOST);
    for (int i = 0; i < cycles; i++) {
        for (int fmu = 6; fmu + 4 < n; fmu += 5) {
            int code = run(given + fmu, atof(given[2]), atof(given[3]), strtod(given[4], NULL), given[5]);
            if (code) return code;
        }
        if (i % 50 == 49) printf("%ld\n", resident()), fflush(stdout);
    }
    return 0;
}
