/* Lets calls of the operating system fail, in whatever library they are made: HDF5, Python, the
 * encoders of pictures. `faults.py` compiles it, and preloads it into the process that it tries.
 *
 * Counted are the calls that touch files below one folder, either those that read or those that
 * write; the `first` of them fails, and with `forever` all that follow.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/types.h>
#include <unistd.h>

static char folder[PATH_MAX];
static long first, count;
static int forever, reading, number;

/* For Python, by ctypes: arm the next fault, and ask how many calls there were. */
void faults_arm(const char *below, long nth, int for_ever, int reads, int error)
{
    strncpy(folder, below, sizeof folder - 1);
    first = nth, forever = for_ever, reading = reads, number = error, count = 0;
}

long faults_count(void)
{
    return count;
}

static int fails(const char *path, int reads)
{
    if (!first || reads != reading || strncmp(path, folder, strlen(folder)))
        return 0;
    count++;
    if (count < first || (count > first && !forever))
        return 0;
    errno = number;
    return 1;
}

static int fails_at(int descriptor, int reads)
{
    char name[64], path[PATH_MAX] = "";
    if (!first)
        return 0;
    snprintf(name, sizeof name, "/proc/self/fd/%d", descriptor);
    return readlink(name, path, sizeof path - 1) > 0 && fails(path, reads);
}

#define REAL(name) ((__typeof__(&name))dlsym(RTLD_NEXT, #name))

#define CALL(type, name, parameters, failure, arguments) \
    type name parameters { return failure ? (type)-1 : REAL(name) arguments; }

CALL(ssize_t, write, (int d, const void *b, size_t n), fails_at(d, 0), (d, b, n))
CALL(ssize_t, pwrite, (int d, const void *b, size_t n, off_t o), fails_at(d, 0), (d, b, n, o))
CALL(ssize_t, pwrite64, (int d, const void *b, size_t n, off64_t o), fails_at(d, 0), (d, b, n, o))
CALL(ssize_t, read, (int d, void *b, size_t n), fails_at(d, 1), (d, b, n))
CALL(ssize_t, pread, (int d, void *b, size_t n, off_t o), fails_at(d, 1), (d, b, n, o))
CALL(ssize_t, pread64, (int d, void *b, size_t n, off64_t o), fails_at(d, 1), (d, b, n, o))
CALL(int, fsync, (int d), fails_at(d, 0), (d))
CALL(int, ftruncate, (int d, off_t n), fails_at(d, 0), (d, n))
CALL(int, ftruncate64, (int d, off64_t n), fails_at(d, 0), (d, n))
CALL(int, fchmod, (int d, mode_t m), fails_at(d, 0), (d, m))
CALL(int, chmod, (const char *p, mode_t m), fails(p, 0), (p, m))
CALL(int, mkdir, (const char *p, mode_t m), fails(p, 0), (p, m))
CALL(int, unlink, (const char *p), fails(p, 0), (p))
CALL(int, rename, (const char *a, const char *b), fails(b, 0), (a, b))
CALL(int, link, (const char *a, const char *b), fails(b, 0), (a, b))

/* What opens a file writes, if it may change or make it. */
#define OPEN(name, parameters, arguments)                                   \
    int name parameters                                                           \
    {                                                                             \
        va_list more;                                                             \
        va_start(more, flags);                                                    \
        mode_t mode = flags & O_CREAT ? va_arg(more, mode_t) : 0;                 \
        va_end(more);                                                             \
        int reads = !(flags & (O_WRONLY | O_RDWR | O_CREAT));                     \
        return fails(path, reads) ? -1 : REAL(name) arguments;                    \
    }

OPEN(open, (const char *path, int flags, ...), (path, flags, mode))
OPEN(open64, (const char *path, int flags, ...), (path, flags, mode))
OPEN(openat, (int at, const char *path, int flags, ...), (at, path, flags, mode))
OPEN(openat64, (int at, const char *path, int flags, ...), (at, path, flags, mode))
