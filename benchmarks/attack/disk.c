/* Preloaded before a process: counts its calls that change the disk below a folder, and interrupts the n-th. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/types.h>
#include <sys/uio.h>
#include <unistd.h>

enum { COUNT = 0, KILL = 1, INTERRUPT = 2, ERROR = 3, ERROR_FROM_HERE_ON = 4 };

static char root[PATH_MAX];
static long target = -1, seen = 0;
static int mode = COUNT, number = 0;
static char last[32];

void attack_arm(const char *folder, long n, int what, int error) {
    snprintf(root, sizeof root, "%s", folder);
    target = n, mode = what, number = error, seen = 0, last[0] = 0;
}
long attack_seen(void) { return seen; }
const char *attack_call(void) { return last; }

static int below(const char *path) {
    size_t n = strlen(root);
    return n && strncmp(path, root, n) == 0 && (path[n] == '/' || path[n] == 0);
}
static int below_fd(int fd, const char *path) {
    char link[64], place[PATH_MAX * 2];
    if (path && path[0] == '/') return below(path);
    if (fd == AT_FDCWD) snprintf(link, sizeof link, "/proc/self/cwd");
    else snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t n = readlink(link, place, PATH_MAX);
    if (n < 0) return 0;
    place[n] = 0;
    if (path) snprintf(place + n, sizeof place - n, "/%s", path);
    return below(place);
}
/* 1: the call must fail with `number` */
static int met(const char *name) {
    long k = __atomic_add_fetch(&seen, 1, __ATOMIC_SEQ_CST);
    if (mode == COUNT || target < 0 || k < target || (k > target && mode != ERROR_FROM_HERE_ON)) return 0;
    if (k == target) snprintf(last, sizeof last, "%s", name);
    if (mode == KILL) kill(getpid(), SIGKILL);
    if (mode == INTERRUPT) { kill(getpid(), SIGINT); return 0; }
    if (mode == ERROR_FROM_HERE_ON && (!strcmp(name, "unlink") || !strcmp(name, "rmdir") || !strcmp(name, "rename")))
        return 0; /* a full disk lets these through */
    errno = number;
    return 1;
}
#define REAL(name) static __typeof__(name) *real; if (!real) real = dlsym(RTLD_NEXT, #name)
#define HIT(inside, name, call) do { if (root[0] && (inside) && met(name)) return -1; return call; } while (0)

ssize_t write(int fd, const void *b, size_t n) { REAL(write); HIT(below_fd(fd, 0), "write", real(fd, b, n)); }
ssize_t writev(int fd, const struct iovec *b, int n) { REAL(writev); HIT(below_fd(fd, 0), "write", real(fd, b, n)); }
ssize_t pwrite(int fd, const void *b, size_t n, off_t o) { REAL(pwrite); HIT(below_fd(fd, 0), "write", real(fd, b, n, o)); }
ssize_t pwrite64(int fd, const void *b, size_t n, off64_t o) { REAL(pwrite64); HIT(below_fd(fd, 0), "write", real(fd, b, n, o)); }
int fsync(int fd) { REAL(fsync); HIT(below_fd(fd, 0), "fsync", real(fd)); }
int fdatasync(int fd) { REAL(fdatasync); HIT(below_fd(fd, 0), "fsync", real(fd)); }
int ftruncate(int fd, off_t n) { REAL(ftruncate); HIT(below_fd(fd, 0), "truncate", real(fd, n)); }
int ftruncate64(int fd, off64_t n) { REAL(ftruncate64); HIT(below_fd(fd, 0), "truncate", real(fd, n)); }
int rename(const char *a, const char *b) { REAL(rename); HIT(below_fd(AT_FDCWD, b), "rename", real(a, b)); }
int renameat(int d, const char *a, int e, const char *b) { REAL(renameat); HIT(below_fd(e, b), "rename", real(d, a, e, b)); }
int unlink(const char *a) { REAL(unlink); HIT(below_fd(AT_FDCWD, a), "unlink", real(a)); }
int unlinkat(int d, const char *a, int f) {
    REAL(unlinkat); HIT(below_fd(d, a), f & AT_REMOVEDIR ? "rmdir" : "unlink", real(d, a, f));
}
int rmdir(const char *a) { REAL(rmdir); HIT(below_fd(AT_FDCWD, a), "rmdir", real(a)); }
int mkdir(const char *a, mode_t m) { REAL(mkdir); HIT(below_fd(AT_FDCWD, a), "mkdir", real(a, m)); }
int mkdirat(int d, const char *a, mode_t m) { REAL(mkdirat); HIT(below_fd(d, a), "mkdir", real(d, a, m)); }
int chmod(const char *a, mode_t m) { REAL(chmod); HIT(below_fd(AT_FDCWD, a), "chmod", real(a, m)); }
int symlink(const char *a, const char *b) { REAL(symlink); HIT(below_fd(AT_FDCWD, b), "link", real(a, b)); }
int link(const char *a, const char *b) { REAL(link); HIT(below_fd(AT_FDCWD, b), "link", real(a, b)); }

#define WRITES(f) ((f) & (O_CREAT | O_TRUNC))
#define MODE(f, m) mode_t m = 0; if ((f) & (O_CREAT | O_TMPFILE)) { va_list v; va_start(v, f); m = va_arg(v, mode_t); va_end(v); }
int open(const char *a, int f, ...) { MODE(f, m) REAL(open); HIT(WRITES(f) && below_fd(AT_FDCWD, a), "open", real(a, f, m)); }
int open64(const char *a, int f, ...) { MODE(f, m) REAL(open64); HIT(WRITES(f) && below_fd(AT_FDCWD, a), "open", real(a, f, m)); }
int openat(int d, const char *a, int f, ...) { MODE(f, m) REAL(openat); HIT(WRITES(f) && below_fd(d, a), "open", real(d, a, f, m)); }
int openat64(int d, const char *a, int f, ...) { MODE(f, m) REAL(openat64); HIT(WRITES(f) && below_fd(d, a), "open", real(d, a, f, m)); }
FILE *fopen(const char *a, const char *m) {
    REAL(fopen);
    if (root[0] && strpbrk(m, "wa+") && below_fd(AT_FDCWD, a) && met("open")) return 0;
    return real(a, m);
}
FILE *fopen64(const char *a, const char *m) {
    REAL(fopen64);
    if (root[0] && strpbrk(m, "wa+") && below_fd(AT_FDCWD, a) && met("open")) return 0;
    return real(a, m);
}
