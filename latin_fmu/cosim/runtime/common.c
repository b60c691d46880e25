/* What instances of both kinds share: messages, texts, the path of the resources. */
#include "instance.h"

#include <ctype.h>
#include <stdio.h>

static const char *category(int status)
{
    static const char *names[] = {"logAll", "logStatusWarning", "logStatusDiscard", "logStatusError", "logStatusFatal"};
    return names[status < OK || status > FATAL ? FATAL : status];
}

void emit(const Instance *c, int status, const char *text) { c->emit(c, status, category(status), text); }

char *copied(const char *text)
{
    char *copy = malloc(strlen(text) + 1);
    return copy ? strcpy(copy, text) : NULL;
}

int unsupported(Instance *c, const char *function)
{
    char text[200];
    if (c == NULL) return ERROR;
    snprintf(text, sizeof text, "%s is not supported by this FMU", function);
    emit(c, ERROR, text);
    return ERROR;
}

static int digit(char c) { return isdigit((unsigned char)c) ? c - '0' : tolower((unsigned char)c) - 'a' + 10; }

static int is_folder_of_resources(const char *folder)
{
    size_t size = strlen(folder) + strlen(known_file) + 2;
    char *path = malloc(size);
    if (path == NULL) return 0;
    snprintf(path, size, "%s/%s", folder, known_file);
    FILE *file = fopen(path, "r");
    free(path);
    if (file != NULL) fclose(file);
    return file != NULL;
}

/* A path from a URI: file:///a%20b, file://localhost/a, file:/a; a path of its own stays as it is. */
char *path_of(const char *uri)
{
    char *raw = malloc(strlen(uri) + 1), *path = malloc(strlen(uri) + 1), *to = path;
    if (raw == NULL || path == NULL) return NULL;
    if (strncmp(uri, "file:", 5) == 0) {
        uri += 5;
        if (strncmp(uri, "//", 2) == 0) {
            uri += 2;
            if (strncmp(uri, "localhost/", 10) == 0) uri += 9;  /* the / stays */
        }
#ifdef _WIN32
        if (uri[0] == '/' && isalpha((unsigned char)uri[1]) && uri[2] == ':') uri++;  /* /C:/a -> C:/a */
#endif
    }
    strcpy(raw, uri);
    for (; *uri; uri++) {
        if (*uri == '%' && isxdigit((unsigned char)uri[1]) && isxdigit((unsigned char)uri[2])) {
            *to++ = (char)(16 * digit(uri[1]) + digit(uri[2]));
            uri += 2;
        } else
            *to++ = *uri;
    }
    *to = '\0';
    /* a host that writes no percent signs for its own */
    if (!is_folder_of_resources(path) && is_folder_of_resources(raw)) strcpy(path, raw);
    free(raw);
    return path;
}
