/*
 * A library to be preloaded into the server: makes one write to the store fail, as a full disk, a broken disk, a process
 * without file descriptors or a locked file would.
 *
 * The control file named by FAULTS_CONTROL holds two 64-bit numbers that the test and the server share:
 *   [0] how many calls there are still to go before one fails; the call that takes it from 1 to 0 fails; 0: none does
 *   [1] the errno of the failure
 *   [2] calls counted so far
 *   [3] the errno with which a quota refuses all that takes room: every write, and the creation of a file; 0: there is room
 * Counted are the calls that change a file below FAULTS_FOLDER: open for creating, write, pwrite, fsync, fdatasync,
 * ftruncate, rename, unlink, mkdir, and taking a lock (fcntl).
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/types.h>
#include <sys/uio.h>
#include <unistd.h>

static volatile int64_t *control;
static const char *folder;
static size_t folder_length;

#define REAL(name) ((__typeof__(&name))dlsym(RTLD_NEXT, #name))

__attribute__((constructor)) static void begin(void) {
    const char *path = getenv("FAULTS_CONTROL");
    folder = getenv("FAULTS_FOLDER");
    if (!path || !folder)
        return;
    folder_length = strlen(folder);
    int fd = REAL(open)(path, O_RDWR);
    void *memory = mmap(NULL, 4 * sizeof(int64_t), PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
    control = memory == MAP_FAILED ? NULL : memory;
    close(fd);
}

static int is_ours(const char *path) {
    return control && path && strncmp(path, folder, folder_length) == 0;
}

static int is_our_file(int fd) {
    char link[64], path[PATH_MAX];
    if (!control)
        return 0;
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t length = readlink(link, path, sizeof path - 1);
    if (length < 0)
        return 0;
    path[length] = 0;
    return is_ours(path);
}

/* Counts a call; true when it is the one that fails. */
static int fails(void) {
    __atomic_add_fetch(&control[2], 1, __ATOMIC_SEQ_CST);
    int64_t left = __atomic_load_n(&control[0], __ATOMIC_SEQ_CST);
    while (left > 0)
        if (__atomic_compare_exchange_n(&control[0], &left, left - 1, 0, __ATOMIC_SEQ_CST, __ATOMIC_SEQ_CST)) {
            if (left != 1)
                return 0;
            errno = (int)control[1];
            return 1;
        }
    return 0;
}

/* True where a quota has no room for a call that takes some. */
static int is_over_quota(void) {
    if (!control || !control[3])
        return 0;
    errno = (int)control[3];
    return 1;
}

#define ON_FILE(type, name, parameters, arguments)  \
    type name parameters {                          \
        if (is_our_file(fd) && fails())             \
            return -1;                              \
        return REAL(name) arguments;                \
    }

#define ON_GROWTH(type, name, parameters, arguments)               \
    type name parameters {                                         \
        if (is_our_file(fd) && (is_over_quota() || fails()))       \
            return -1;                                             \
        return REAL(name) arguments;                               \
    }

#define ON_PATH(name, parameters, arguments)        \
    int name parameters {                           \
        if (is_ours(path) && fails())               \
            return -1;                              \
        return REAL(name) arguments;                \
    }

ON_GROWTH(ssize_t, write, (int fd, const void *bytes, size_t count), (fd, bytes, count))
ON_GROWTH(ssize_t, writev, (int fd, const struct iovec *pieces, int count), (fd, pieces, count))
ON_GROWTH(ssize_t, pwrite, (int fd, const void *bytes, size_t count, off_t at), (fd, bytes, count, at))
ON_GROWTH(ssize_t, pwrite64, (int fd, const void *bytes, size_t count, off64_t at), (fd, bytes, count, at))
ON_FILE(int, fsync, (int fd), (fd))
ON_FILE(int, fdatasync, (int fd), (fd))
ON_FILE(int, ftruncate, (int fd, off_t length), (fd, length))
ON_FILE(int, ftruncate64, (int fd, off64_t length), (fd, length))
ON_PATH(rename, (const char *path, const char *to), (path, to))
ON_PATH(unlink, (const char *path), (path))
ON_PATH(mkdir, (const char *path, mode_t mode), (path, mode))

#define OPEN(name)                                            \
    int name(const char *path, int flags, ...) {              \
        va_list rest;                                         \
        va_start(rest, flags);                                \
        mode_t mode = flags & O_CREAT ? va_arg(rest, mode_t) : 0; \
        va_end(rest);                                         \
        int creates = flags & O_CREAT && is_ours(path) && access(path, F_OK) != 0; \
        if ((creates && is_over_quota()) || (is_ours(path) && fails())) \
            return -1;                                        \
        return REAL(name)(path, flags, mode);                 \
    }
OPEN(open)
OPEN(open64)

/* SQLite takes its locks with F_SETLK. */
#define FCNTL(name)                                                                              \
    int name(int fd, int command, ...) {                                                         \
        va_list rest;                                                                            \
        va_start(rest, command);                                                                 \
        void *argument = va_arg(rest, void *);                                                   \
        va_end(rest);                                                                            \
        if (command == F_SETLK && ((struct flock *)argument)->l_type != F_UNLCK && is_our_file(fd) && fails()) \
            return -1;                                                                           \
        return REAL(name)(fd, command, argument);                                                \
    }
FCNTL(fcntl)
FCNTL(fcntl64)
