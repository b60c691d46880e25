/* Which function of the FMI may be called in which state: FMI 2.0.4, section 4.2.4; FMI 3.0, sections 2.3, 3.2 and 4.2.

   A step here is never in progress when a function returns, and there is no event mode in co-simulation: the states for
   them are left out. A call that is refused changes nothing, so that its state stays. */
#include "instance.h"

#include <stdio.h>

enum { LONGEST = 400 };

#define IN(phase) (1u << (phase))
enum {
    ANY = IN(N_PHASE) - 1,
    RAN = IN(STEP) | IN(STEP_FAILED) | IN(TERMINATED),
    MODES = IN(EVENT) | IN(CONTINUOUS),
    KNOWN = IN(INITIALIZATION) | RAN | MODES | IN(FAILED), /* where values can be read */
    SETTABLE = IN(INSTANTIATED) | IN(CONFIGURATION) | IN(INITIALIZATION) | IN(STEP) | MODES,
    EVALUATED = IN(INITIALIZATION) | MODES | IN(TERMINATED) | IN(FAILED)
};

/* By version and interface: co-simulation of FMI 2, of FMI 3, Model Exchange of FMI 3. */
static const uint16_t table[N_CALL][3] = {
    [ALWAYS] = {ANY, ANY, ANY}, /* logging, reset, states of the FMU */
    [SETUP] = {IN(INSTANTIATED), 0, 0},
    [ENTER_CONFIGURATION] = {0, IN(INSTANTIATED), IN(INSTANTIATED)},
    [EXIT_CONFIGURATION] = {0, IN(CONFIGURATION), IN(CONFIGURATION)},
    [ENTER_INITIALIZATION] = {IN(INSTANTIATED), IN(INSTANTIATED), IN(INSTANTIATED)},
    [EXIT_INITIALIZATION] = {IN(INITIALIZATION), IN(INITIALIZATION), IN(INITIALIZATION)},
    [TERMINATE] = {IN(STEP) | IN(STEP_FAILED), IN(STEP), MODES},
    [GET] = {KNOWN, KNOWN | IN(INSTANTIATED) | IN(CONFIGURATION), KNOWN | IN(INSTANTIATED) | IN(CONFIGURATION)},
    [SET] = {SETTABLE, SETTABLE, SETTABLE},
    [DIFFERENTIATE] = {KNOWN, KNOWN, KNOWN},
    [DO_STEP] = {IN(STEP), IN(STEP), 0},
    [GET_STATUS] = {RAN, 0, 0},
    [ENTER_EVENT] = {0, 0, IN(CONTINUOUS)},
    [ENTER_CONTINUOUS] = {0, 0, IN(EVENT)},
    [UPDATE] = {0, 0, IN(EVENT)},
    [SET_CONTINUOUS] = {0, 0, MODES},
    [INTEGRATED] = {0, 0, IN(CONTINUOUS)},
    [COUNT_STATES] = {0, 0, ANY & ~IN(FAILED)},
    [EVALUATE] = {0, 0, EVALUATED}};

static const char *name_of(int kind, int phase)
{
    static const char *names[] = {
        "Instantiated", "Configuration Mode", "Initialization Mode", "error (initialization failed, see the message before)",
        "Event Mode", "Continuous-Time Mode", "Step Mode", "stepFailed (the step before was discarded)", "Terminated"};
    return kind == COSIMULATION_2 && phase == STEP ? "stepComplete" : names[phase];
}

int allowed(const Instance *c, int call, const char *function)
{
    if (c == NULL) return 0;
    unsigned phases = table[call][c->kind];
    if (phases & IN(c->phase)) return 1;
    char text[LONGEST];
    int n = snprintf(text, sizeof text, "%s is not allowed in the state %s; allowed in: ", function,
                     name_of(c->kind, c->phase));
    for (int phase = 0; phase < N_PHASE; phase++)
        if (phases & IN(phase) && phase != FAILED && n < LONGEST) {
            const char *name = name_of(c->kind, phase);
            /* without what stands in parentheses, and the blank before it */
            size_t most = strcspn(name, "(");
            n += snprintf(text + n, (size_t)(LONGEST - n), "%.*s, ", (int)(name[most] ? most - 1 : most), name);
        }
    if (phases == 0)
        snprintf(text, sizeof text, "%s is not allowed in the state %s: it is no function of this kind of FMU", function,
                 name_of(c->kind, c->phase));
    else if (n < LONGEST)
        text[n - 2] = '\0';  /* the last comma */
    emit(c, ERROR, text);
    return 0;
}

int entered(Instance *c, int status, int phase)
{
    if (status < DISCARD) c->phase = phase;  /* a call that failed or a step that was discarded leaves the state */
    return status;
}
