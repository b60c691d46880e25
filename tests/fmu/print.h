/* Logger of FMI 2 for hosts in C: prints status and message to stderr. */
#include <stdarg.h>
#include <stdio.h>

static void print(void *e, const char *name, int status, const char *category, const char *format, ...)
{
    (void)e, (void)name, (void)category;
    va_list given;
    va_start(given, format);
    fprintf(stderr, "[%d] ", status);
    vfprintf(stderr, format, given);
    fprintf(stderr, "\n");
    va_end(given);
}
