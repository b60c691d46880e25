/* What the library holds besides the kernels: whether the processor runs it, and the memory of kernels that
   allocate. */

#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#if defined(_WIN32)
#define WIN32_LEAN_AND_MEAN
#include <windows.h>
#else
#include <sched.h>
#endif

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

/* 1 where the processor and the operating system have what the kernels were compiled for: x86-64-v3, or x86-64-v2. */
EXPORT int latin_fmu_fits(void)
{
#if defined(LATIN_FMU_WIDE)
    uint32_t a, b, c, d;
    __asm__ volatile("cpuid" : "=a"(a), "=b"(b), "=c"(c), "=d"(d) : "a"(0), "c"(0));
    if (a < 7)
        return 0;
    __asm__ volatile("cpuid" : "=a"(a), "=b"(b), "=c"(c), "=d"(d) : "a"(1), "c"(0));
    /* FMA, MOVBE, XSAVE in use by the operating system, AVX, F16C */
    const uint32_t first = 1u << 12 | 1u << 22 | 1u << 27 | 1u << 28 | 1u << 29;
    if ((c & first) != first)
        return 0;
    __asm__ volatile("xgetbv" : "=a"(a), "=d"(d) : "c"(0));
    if ((a & 6) != 6)
        return 0; /* the operating system does not keep the wide registers */
    __asm__ volatile("cpuid" : "=a"(a), "=b"(b), "=c"(c), "=d"(d) : "a"(7), "c"(0));
    const uint32_t second = 1u << 3 | 1u << 5 | 1u << 8; /* BMI1, AVX2, BMI2 */
    if ((b & second) != second)
        return 0;
    __asm__ volatile("cpuid" : "=a"(a), "=b"(b), "=c"(c), "=d"(d) : "a"(0x80000001u), "c"(0));
    return (c >> 5 & 1) != 0; /* LZCNT */
#elif defined(__x86_64__)
    uint32_t a, b, c, d;
    __asm__ volatile("cpuid" : "=a"(a), "=b"(b), "=c"(c), "=d"(d) : "a"(1), "c"(0));
    const uint32_t needed = 1u << 9 | 1u << 19 | 1u << 20 | 1u << 23; /* SSSE3, SSE4.1, SSE4.2, POPCNT */
    return (c & needed) == needed;
#else
    return 1; /* the code is for every processor of its kind, on macOS for the first of them */
#endif
}

/* A thread that waits gives up its core. */
#if defined(_WIN32)
int latin_fmu_yield(void) { return SwitchToThread(); }
#else
int latin_fmu_yield(void) { return sched_yield(); }
#endif

/* Memory of arrays, as numba lays it out: the compiled code reads the fields. */
typedef struct {
    size_t references;
    void (*destructor)(void *, size_t, void *);
    void *destructor_argument;
    void *data;
    size_t size;
    void *allocator;
} MemInfo;

void *NRT_Allocate(size_t size) { return malloc(size); }
void NRT_Free(void *memory) { free(memory); }

MemInfo *NRT_MemInfo_alloc_aligned(size_t size, unsigned align)
{
    MemInfo *block = malloc(sizeof(MemInfo) + size + 2 * (size_t)align);
    if (!block)
        return NULL;
    memset(block, 0, sizeof *block);
    block->references = 1;
    block->size = size;
    block->data = (void *)(((uintptr_t)(block + 1) + align) / align * align);
    return block;
}

MemInfo *NRT_MemInfo_alloc(size_t size) { return NRT_MemInfo_alloc_aligned(size, 16); }
void NRT_MemInfo_call_dtor(MemInfo *memory) { free(memory); }

/* Never reached: numba's code names them for errors that contiguous arrays of equal lengths do not give. */
void *PyExc_RuntimeError;
void PyErr_SetString(void *kind, const char *message) { (void)kind, (void)message, abort(); }
void *PyObject_Hash(void *object) { (void)object, abort(); }
void *PyTuple_Pack(intptr_t n, ...) { (void)n, abort(); }
void *PyUnicode_FromKindAndData(int kind, const void *data, intptr_t size) { (void)kind, (void)data, (void)size, abort(); }
