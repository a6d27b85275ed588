/* Watches the calls of the operating system, in whatever library they are made: HDF5, Python, the
 * encoders of pictures. `faults.py` compiles it, and preloads it into the process that it tries.
 *
 * Counted are the calls that touch files below one folder, either those that read or those that
 * write; the `first` of them fails, and with `forever` all that follow. Or those that write are
 * logged, with their bytes, so that a disk that loses its power can be made of them.
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

#define REAL(name) ((__typeof__(&name))dlsym(RTLD_NEXT, #name))

static char folder[PATH_MAX];
static long first, count;
static int forever, reading, number, logged = -1;

/* For Python, by ctypes: arm the next fault, ask how many calls there were, or begin a log. */
void faults_arm(const char *below, long nth, int for_ever, int reads, int error)
{
    strncpy(folder, below, sizeof folder - 1);
    first = nth, forever = for_ever, reading = reads, number = error, count = 0;
}

long faults_count(void)
{
    return count;
}

void faults_log(const char *below, const char *file)
{
    strncpy(folder, below, sizeof folder - 1);
    logged = REAL(open)(file, O_CREAT | O_APPEND | O_WRONLY, 0600);
}

/* The path that a name stands for in a folder (AT_FDCWD: the current one), or that is open there. */
static const char *absolute(int at, const char *name, char *path)
{
    char link[64];
    ssize_t size;
    if (name[0] == '/')
        return name;
    snprintf(link, sizeof link, at == AT_FDCWD ? "/proc/self/cwd" : "/proc/self/fd/%d", at);
    if ((size = readlink(link, path, PATH_MAX - 1)) < 0)
        size = 0;
    snprintf(path + size, PATH_MAX - size, "%s%s", name[0] ? "/" : "", name);
    return path;
}

static int is_below(const char *path)
{
    return !strncmp(path, folder, strlen(folder));
}

static int fails(int at, const char *name, int reads)
{
    char path[PATH_MAX] = "";
    if (!first || reads != reading || !is_below(absolute(at, name, path)))
        return 0;
    count++;
    if (count < first || (count > first && !forever))
        return 0;
    errno = number;
    return 1;
}

/* A line of the log: what was done to which file, and after it the bytes that were written. */
static void note(const char *what, int at, const char *name, const char *to, const void *data,
                 ssize_t size, off_t offset)
{
    char path[PATH_MAX] = "", target[PATH_MAX] = "", line[2 * PATH_MAX + 128];
    struct stat status = {0};
    int error = errno;
    if (logged < 0 || !is_below(absolute(at, name, path)))
        return;
    stat(to ? absolute(AT_FDCWD, to, target) : absolute(at, name, path), &status);
    if (!name[0])
        fstat(at, &status);
    int length = snprintf(line, sizeof line, "%s\t%lu\t%ld\t%ld\t%s\t%s\n", what,
                          (unsigned long)status.st_ino, (long)offset, (long)size,
                          absolute(at, name, path), to ? absolute(AT_FDCWD, to, target) : "");
    (void)!REAL(write)(logged, line, length);
    if (data)
        (void)!REAL(write)(logged, data, size);
    errno = error;
}

#define CALL(type, name, parameters, failure, arguments, noted) \
    type name parameters                                        \
    {                                                           \
        if (failure)                                            \
            return (type)-1;                                    \
        type result = REAL(name) arguments;                     \
        if (result != (type)-1) {                               \
            noted;                                              \
        }                                                       \
        return result;                                          \
    }

#define HERE AT_FDCWD
#define WROTE(offset) note("write", d, "", 0, b, result, offset)
#define DID(what, at, name, to) note(what, at, name, to, 0, 0, 0)

CALL(ssize_t, write, (int d, const void *b, size_t n), fails(d, "", 0), (d, b, n),
     WROTE(lseek(d, 0, SEEK_CUR) - result))
CALL(ssize_t, pwrite, (int d, const void *b, size_t n, off_t o), fails(d, "", 0), (d, b, n, o),
     WROTE(o))
CALL(ssize_t, pwrite64, (int d, const void *b, size_t n, off64_t o), fails(d, "", 0), (d, b, n, o),
     WROTE(o))
CALL(ssize_t, read, (int d, void *b, size_t n), fails(d, "", 1), (d, b, n), )
CALL(ssize_t, pread, (int d, void *b, size_t n, off_t o), fails(d, "", 1), (d, b, n, o), )
CALL(ssize_t, pread64, (int d, void *b, size_t n, off64_t o), fails(d, "", 1), (d, b, n, o), )
CALL(int, fsync, (int d), fails(d, "", 0), (d), DID("sync", d, "", 0))
CALL(int, ftruncate, (int d, off_t n), fails(d, "", 0), (d, n), note("cut", d, "", 0, 0, 0, n))
CALL(int, ftruncate64, (int d, off64_t n), fails(d, "", 0), (d, n), note("cut", d, "", 0, 0, 0, n))
CALL(int, fchmod, (int d, mode_t m), fails(d, "", 0), (d, m), )
CALL(int, chmod, (const char *p, mode_t m), fails(HERE, p, 0), (p, m), )
CALL(int, mkdir, (const char *p, mode_t m), fails(HERE, p, 0), (p, m), DID("mkdir", HERE, p, 0))
CALL(int, rename, (const char *a, const char *b), fails(HERE, b, 0), (a, b),
     DID("rename", HERE, a, b))
CALL(int, link, (const char *a, const char *b), fails(HERE, b, 0), (a, b), DID("link", HERE, a, b))
CALL(int, unlink, (const char *p), fails(HERE, p, 0), (p), DID("unlink", HERE, p, 0))
CALL(int, rmdir, (const char *p), fails(HERE, p, 0), (p), DID("unlink", HERE, p, 0))
CALL(int, unlinkat, (int at, const char *p, int f), fails(at, p, 0), (at, p, f),
     DID("unlink", at, p, 0))

/* What opens a file writes, if it may change or make it. */
#define OPEN(name, at, parameters, arguments)                           \
    int name parameters                                                 \
    {                                                                   \
        va_list more;                                                   \
        va_start(more, flags);                                          \
        mode_t mode = flags & O_CREAT ? va_arg(more, mode_t) : 0;       \
        va_end(more);                                                   \
        char full[PATH_MAX] = "";                                       \
        int reads = !(flags & (O_WRONLY | O_RDWR | O_CREAT));           \
        if (fails(at, path, reads))                                     \
            return -1;                                                  \
        int makes = flags & O_CREAT && access(absolute(at, path, full), F_OK); \
        int result = REAL(name) arguments;                              \
        if (result >= 0 && makes)                                       \
            DID("make", result, "", 0);                                 \
        else if (result >= 0 && flags & O_TRUNC)                        \
            note("cut", result, "", 0, 0, 0, 0);                        \
        return result;                                                  \
    }

OPEN(open, HERE, (const char *path, int flags, ...), (path, flags, mode))
OPEN(open64, HERE, (const char *path, int flags, ...), (path, flags, mode))
OPEN(openat, at, (int at, const char *path, int flags, ...), (at, path, flags, mode))
OPEN(openat64, at, (int at, const char *path, int flags, ...), (at, path, flags, mode))
