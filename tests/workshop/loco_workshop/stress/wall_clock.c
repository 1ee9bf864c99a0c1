// SPDX-License-Identifier: Apache-2.0
//
// Preloaded, it sets the wall clock of a process forward or back without touching the machine's:
// by the nanoseconds in the file that LOCO_WALL_CLOCK names. All processes with that file share
// one clock, and see it jump at once. The monotonic clock goes on, as in a machine whose wall clock
// is set. Waits until a time of the wall clock are shifted back for the kernel, which knows nothing.
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <pthread.h>
#include <semaphore.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/time.h>
#include <time.h>

#define WALL 1000000000  // seconds; a monotonic clock shows less for 31 years after its start
#define REAL(name, version) \
    static __typeof__(name) *real; \
    if (!real && !(real = dlvsym(RTLD_NEXT, #name, version))) real = dlsym(RTLD_NEXT, #name)

static volatile int64_t *offset;

__attribute__((constructor)) static void open_clock(void) {
    const char *path = getenv("LOCO_WALL_CLOCK");
    int file = path ? open(path, O_RDONLY | O_CLOEXEC) : -1;
    void *memory = mmap(NULL, sizeof *offset, PROT_READ, MAP_SHARED, file, 0);
    if (memory != MAP_FAILED) offset = memory;
}

static struct timespec shifted(struct timespec t, int sign) {
    int64_t by = offset ? sign * *offset : 0, nanoseconds = t.tv_nsec + by % 1000000000;
    t.tv_sec += by / 1000000000 + (nanoseconds >= 1000000000) - (nanoseconds < 0);
    t.tv_nsec = (nanoseconds + 1000000000) % 1000000000;
    return t;
}

static struct timespec for_kernel(const struct timespec *t) {
    return t->tv_sec > WALL ? shifted(*t, -1) : *t;
}

int clock_gettime(clockid_t id, struct timespec *t) {
    REAL(clock_gettime, "GLIBC_2.17");
    int code = real(id, t);
    if (!code && (id == CLOCK_REALTIME || id == CLOCK_REALTIME_COARSE)) *t = shifted(*t, 1);
    return code;
}

int gettimeofday(struct timeval *t, void *zone) {
    struct timespec now;
    (void)zone;
    int code = clock_gettime(CLOCK_REALTIME, &now);
    *t = (struct timeval){now.tv_sec, now.tv_nsec / 1000};
    return code;
}

time_t time(time_t *t) {
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    return t ? *t = now.tv_sec : now.tv_sec;
}

int pthread_cond_timedwait(pthread_cond_t *c, pthread_mutex_t *m, const struct timespec *t) {
    REAL(pthread_cond_timedwait, "GLIBC_2.3.2");
    struct timespec end = for_kernel(t);
    return real(c, m, &end);
}

int pthread_cond_clockwait(
    pthread_cond_t *c, pthread_mutex_t *m, clockid_t id, const struct timespec *t) {
    REAL(pthread_cond_clockwait, "GLIBC_2.30");
    struct timespec end = for_kernel(t);
    return real(c, m, id, &end);
}

int pthread_mutex_timedlock(pthread_mutex_t *m, const struct timespec *t) {
    REAL(pthread_mutex_timedlock, "GLIBC_2.34");
    struct timespec end = for_kernel(t);
    return real(m, &end);
}

int sem_timedwait(sem_t *s, const struct timespec *t) {
    REAL(sem_timedwait, "GLIBC_2.34");
    struct timespec end = for_kernel(t);
    return real(s, &end);
}

int sem_clockwait(sem_t *s, clockid_t id, const struct timespec *t) {
    REAL(sem_clockwait, "GLIBC_2.34");
    struct timespec end = for_kernel(t);
    return real(s, id, &end);
}
