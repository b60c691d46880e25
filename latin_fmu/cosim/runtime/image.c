/* The files of an FMU: read and checked once per process, shared by its instances, freed with the last. */
#include "runtime.h"

#include <stdio.h>
#include <sys/stat.h>

#ifdef _WIN32
#define WIN32_LEAN_AND_MEAN
#define NOGDI /* its ERROR is 0 */
#include <windows.h>
#define yield() Sleep(0)
#else
#include <sched.h>
#define yield() sched_yield()
#endif

const char known_file[] = "variables.bin"; /* which every FMU has */
static const char image_file[] = "image.bin";

static Image *images;
static char in_use; /* 1 while a thread is in the list */

static void enter(void)
{
    while (__atomic_test_and_set(&in_use, __ATOMIC_ACQUIRE)) yield();
}

static void leave(void) { __atomic_clear(&in_use, __ATOMIC_RELEASE); }

/* -- memory and files ---------------------------------------------------------------------------------------------- */
void *aligned(size_t bytes)
{
    char *block = bytes < SIZE_MAX - 128 ? malloc(bytes + 128) : NULL;  /* no overflow of the sum */
    if (block == NULL) return NULL;
    /* with 64 bytes or more before it: the address of the block lies there */
    char *place = block + 64 + (64 - (uintptr_t)block % 64) % 64;
    memcpy(place - sizeof block, &block, sizeof block);
    return place;
}

void aligned_free(void *place)
{
    char *block = NULL;
    if (place != NULL) memcpy(&block, (char *)place - sizeof block, sizeof block);
    free(block);
}

/* Paths are UTF-8. */
#ifdef _WIN32
enum { LONGEST = 4096 };

static int wide_of(const char *path, wchar_t *wide) { return MultiByteToWideChar(CP_UTF8, 0, path, -1, wide, LONGEST); }
#endif

FILE *file_at(const char *path, const char *how)
{
#ifdef _WIN32
    wchar_t wide[LONGEST];
    if (wide_of(path, wide)) return _wfopen(wide, *how == 'w' ? L"wb" : *how == 'a' ? L"ab" : L"rb");
#endif
    return fopen(path, how);
}

int moved_file(const char *from, const char *to)
{
#ifdef _WIN32
    wchar_t here[LONGEST], there[LONGEST];
    if (wide_of(from, here) && wide_of(to, there)) return MoveFileExW(here, there, MOVEFILE_REPLACE_EXISTING) != 0;
#endif
    return rename(from, to) == 0;
}

void removed_file(const char *path)
{
#ifdef _WIN32
    wchar_t wide[LONGEST];
    if (wide_of(path, wide)) _wremove(wide);
#else
    remove(path);
#endif
}

/* Whether a path is that of something that is no regular file: a pipe, a folder, a device, which reading may never end. */
int is_irregular(const char *path)
{
#ifdef _WIN32
    wchar_t wide[LONGEST];
    struct _stat64 facts;
    return wide_of(path, wide) && _wstat64(wide, &facts) == 0 && (facts.st_mode & _S_IFMT) != _S_IFREG;
#else
    struct stat facts;
    return stat(path, &facts) == 0 && !S_ISREG(facts.st_mode);
#endif
}

char *content_of(const char *path, size_t *length)
{
    FILE *file = file_at(path, "rb");
    if (file == NULL) return NULL;
    char *content = NULL;
    long size = fseek(file, 0, SEEK_END) == 0 ? ftell(file) : -1;
    /* a word of zeros behind the file, and room to move it to a line of the cache */
    if (size >= 0 && fseek(file, 0, SEEK_SET) == 0) content = aligned((size_t)size + 8 * sizeof(Word));
    if (content != NULL) {
        memset(content + size, 0, sizeof(Word));
        *length = fread(content, 1, (size_t)size, file);
        if (*length != (size_t)size) {
            aligned_free(content);
            content = NULL;
        }
    }
    fclose(file);
    return content;
}

/* Sum of the words, each mixed with its place by a one-to-one function: no change of a single word goes unnoticed. */
uint64_t checksum(const void *words, size_t n_word)
{
    uint64_t sum = n_word, word;
    for (size_t i = 0; i < n_word; i++) {
        memcpy(&word, (const char *)words + i * sizeof word, sizeof word);
        word += (i + 1) * 0x9e3779b97f4a7c15u;
        word = (word ^ word >> 30) * 0xbf58476d1ce4e5b9u;
        word = (word ^ word >> 27) * 0x94d049bb133111ebu;
        sum += word ^ word >> 31;
    }
    return sum;
}

/* -- the image ------------------------------------------------------------------------------------------------------- */
char *joined(const char *folder, const char *name)
{
    size_t size = strlen(folder) + strlen(name) + 2;
    char *path = malloc(size);
    if (path != NULL) snprintf(path, size, "%s/%s", folder, name);
    return path;
}

static Word *words_of(const char *folder, const char *name, size_t *n_word, char *trouble, size_t size)
{
    char *path = joined(folder, name);
    size_t length = 0;
    char *content = path ? content_of(path, &length) : NULL;
    if (content == NULL) snprintf(trouble, size, "%s/%s cannot be read: extract the whole FMU", folder, name);
    free(path);
    *n_word = (length + sizeof(Word) - 1) / sizeof(Word);
    return (Word *)content;
}

/* The fixed block is kept by planes, the first bytes of BLOCK words, then the second ones ...: bytes of exponents compress
   beside each other. Brings them together, in place; 0 without memory. */
enum { BLOCK = 1 << 16 };

/* Eight words from eight bytes of each plane, which are m bytes apart: a matrix of 8 x 8 bytes, transposed by halves. */
static void eight_words(const unsigned char *plane, size_t m, unsigned char *to)
{
    uint64_t w[8];
    static const uint64_t low[] = {0x00000000ffffffffu, 0x0000ffff0000ffffu, 0x00ff00ff00ff00ffu};
    for (int k = 0; k < 8; k++) memcpy(w + k, plane + (size_t)k * m, sizeof *w);
    for (int round = 0, apart = 4; apart > 0; round++, apart /= 2)
        for (int k = 0; k < 8; k++)
            if (!(k & apart)) {
                uint64_t swapped = (w[k] >> 8 * apart ^ w[k + apart]) & low[round];
                w[k + apart] ^= swapped;
                w[k] ^= swapped << 8 * apart;
            }
    memcpy(to, w, sizeof w);
}

static int brought_together(const Image *image)
{
    int64_t n = image->head[M_N_FIXED].i;
    unsigned char *planes = malloc(8 * BLOCK);
    for (int64_t at = 0; planes != NULL && at < n; at += BLOCK) {
        size_t some = (size_t)(n - at < BLOCK ? n - at : BLOCK);
        unsigned char *to = (unsigned char *)(image->fixed + at);
        memcpy(planes, to, 8 * some);
        size_t i = 0;
        for (; i + 8 <= some; i += 8) eight_words(planes + i, some, to + 8 * i);
        for (; i < some; i++)
            for (size_t k = 0; k < 8; k++) to[8 * i + k] = planes[k * some + i];
    }
    free(planes);
    return planes != NULL;
}

/* Tables of the fixed block that are factors times another table in it, as the end of the file has them; products are
   rounded before they are added, as those of a session. */
static void multiplied(const Image *image)
{
    enum { TARGET, TARGET_ROW, TARGET_COLUMN, ROWS, COLUMNS, SOURCE, SOURCE_ROW, SOURCE_COLUMN, TERMS, HEAD };
    double *fixed = (double *)image->fixed;
    const Word *at = image->products, *end = at + image->head[M_N_PRODUCT].i;
    while (at < end) {
        const Word *head = at, *factor = at + HEAD;
        for (int64_t i = 0; i < head[ROWS].i; i++)
            for (int64_t j = 0; j < head[TERMS].i; j++, factor++) {
                double *to = fixed + head[TARGET].i + i * head[TARGET_ROW].i;
                const double *from = fixed + head[SOURCE].i + j * head[SOURCE_ROW].i;
                for (int64_t k = 0; k < head[COLUMNS].i; k++) {
                    double part = factor->d * from[k * head[SOURCE_COLUMN].i];
                    to[k * head[TARGET_COLUMN].i] += part;
                }
            }
        at = factor;
    }
}

static void understood_head(Image *image)
{
    image->n_output = image->head[M_N_OUTPUT].i;
    image->n_state = image->head[M_N_STATE].i;
    image->dt = image->head[M_DT].d;
    image->run_table = image->table;
}

/* Blocks and places from the header; 0 where they are not as long as the file. */
static int understood(Image *image, size_t n_word)
{
    const Word *head = image->head;
    if (n_word < M_HEADER || memcmp(head, "LATINIMG", 8) != 0) return 0;
    /* sizes of records are bytes */
    int64_t words[] = {head[M_RUN_SIZE].i / 8, head[M_N_CLASS].i * head[M_CLASS_SIZE].i / 8,
                       head[M_N_GROUP].i * head[M_GROUP_SIZE].i / 8, head[M_N_FIXED].i, head[M_N_MOVING].i,
                       head[M_N_PRODUCT].i};
    uint64_t at = M_HEADER;
    size_t shift = (8 - (size_t)(M_HEADER + words[0] + words[1] + words[2]) % 8) % 8; /* the fixed block on a line of the cache */
    memmove(image->head + shift, head, 8 * n_word);
    head = image->head += shift;
    image->shift = shift;
    for (int i = 0; i < 6; i++) {
        if (i < 3) image->records[i] = (const char *)(head + at);
        if (i == 3) image->fixed = &head[at].d;
        if (i == 4) image->moving = &head[at].d;
        if (i == 5) image->products = head + at;
        at += (uint64_t)words[i];
    }
    understood_head(image);
    return at == n_word;
}

/* Whether these words are a whole table of variables. */
int fits(const Word *table, size_t n_word)
{
    return n_word > T_HEADER && memcmp(table, "LATINVAR", 8) == 0 && table[T_LENGTH].u == n_word &&
           table[T_CHECKSUM].u == checksum(table + T_LENGTH, n_word - T_LENGTH);
}

static int has_table(Image *image, const char *folder, char *trouble, size_t size)
{
    size_t n_table = 0;
    image->table = words_of(folder, known_file, &n_table, trouble, size);
    image->owns_table = 1;
    if (image->table == NULL) return 0;
    const Word *head = image->table;
    if (!fits(head, n_table)) return snprintf(trouble, size, "%s/%s is damaged: extract the FMU again", folder, known_file), 0;
    return 1;
}

static int checked(Image *image, const char *folder, char *trouble, size_t size)
{
    size_t n_word = 0;
    if (!has_table(image, folder, trouble, size)) return 0;
    const Word *head = image->table;
    image->head = words_of(folder, image_file, &n_word, trouble, size);
    if (image->head == NULL) return 0;
    /* the table has its own checksum and that of the image: files of two FMUs do not fit each other */
    if (checksum(image->head, n_word) == head[T_IMAGE].u && understood(image, n_word)) {
        if (!brought_together(image)) return snprintf(trouble, size, "no memory for the FMU"), 0;
        multiplied(image);
        return 1;
    }
    return snprintf(trouble, size, "%s/%s is damaged, or of another FMU: extract the FMU again", folder, image_file), 0;
}

static void dropped(Image *image)
{
    if (image->process != NULL)
        free((void *)image->moving); /* the process keeps what it handed over */
    else
        aligned_free(image->head ? image->head - image->shift : NULL);
    if (image->owns_table) aligned_free(image->table);
    free(image->folder);
    free(image);
}

static Image *opened_image(const char *folder, char *trouble, size_t size)
{
    Image *image = calloc(1, sizeof *image);
    if (image == NULL || (image->folder = copied(folder)) == NULL)
        snprintf(trouble, size, "no memory for the FMU");
    else if (checked(image, folder, trouble, size))
        return image;
    if (image != NULL) dropped(image);
    return NULL;
}

/* Whether the FMU of an image is the one of a token. */
static int is_of(const Image *image, const char *token, char *trouble, size_t size)
{
    const char *own = (const char *)(image->table + image->table[T_TEXTS].i) + image->table[T_TOKEN].i;
    /* one with Python has none in its table */
    if (token == NULL || *token == '\0' || *own == '\0' || strcmp(token, own) == 0) return 1;
    snprintf(trouble, size, "the importer passes the token %.80s, but the files in %.500s belong to the FMU %.80s: extract the FMU "
             "into a separate folder", token, image->folder, own);
    return 0;
}

const Image *image_of(const char *folder, const char *token, char *trouble, size_t size)
{
    enter();
    Image *image = images;
    while (image != NULL && strcmp(image->folder, folder) != 0) image = image->next;
    if (image == NULL && (image = opened_image(folder, trouble, size)) != NULL) {
        image->next = images;
        images = image;
    }
    if (image != NULL) image->users++;
    leave();
    if (image == NULL || is_of(image, token, trouble, size)) return image;
    image_freed(image);
    return NULL;
}

void image_freed(const Image *image)
{
    if (image == NULL) return;
    if (image->unlisted) {
        dropped((Image *)image);
        return;
    }
    enter();
    Image **link = &images;
    while (*link != image) link = &(*link)->next;  /* it is in the list as long as it has users */
    Image *own = *link;
    if (--own->users == 0) {
        *link = own->next;
        dropped(own);
    }
    leave();
}

/* -- images in memory -------------------------------------------------------------------------------------------------- */
const Image *image_of_table(const char *folder, const char *token, char *trouble, size_t size)
{
    Image *image = calloc(1, sizeof *image);
    if (image == NULL || (image->folder = copied(folder)) == NULL)
        snprintf(trouble, size, "no memory for the FMU");
    else if (has_table(image, folder, trouble, size) && is_of(image, token, trouble, size)) {
        const Word *table = image->table, *v = table + table[T_VARIABLES].i;
        for (int64_t i = 0; i < table[T_N_VARIABLE].i; i++, v += V_ROW) image->n_output += v[V_ROLE].i == OUTPUT;
        image->unlisted = 1;
        return image;
    }
    if (image != NULL) dropped(image);
    return NULL;
}

const Image *image_in_memory(const Process *process, const Image *files)
{
    Image *image = calloc(1, sizeof *image);
    size_t bytes = 8 * (size_t)process->head[M_N_MOVING].i;
    double *moving = image ? malloc(bytes + 8) : NULL;
    if (moving == NULL) return free(image), NULL;
    memcpy(moving, process->moving, bytes); /* what every simulation begins from */
    image->process = process;
    image->unlisted = 1;
    image->table = files ? files->table : (Word *)process->table;
    image->head = (Word *)process->head;
    for (int i = 0; i < 3; i++) image->records[i] = process->records[i];
    image->fixed = process->fixed;
    image->moving = moving;
    understood_head(image);
    image->run_table = process->table;
    if (files == NULL) return image;
    if ((image->folder = copied(files->folder)) == NULL) return dropped(image), NULL;
    image->owns_table = files->owns_table; /* it moves on */
    ((Image *)files)->owns_table = 0;
    return image;
}
