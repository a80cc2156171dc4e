/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/socket/listen.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/file.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

enum { LOCK_TRIES = 1000, LOCK_PAUSE_MS = 5 };

/* Serialises daemons that start on one path. */
struct lock {
    int file;
    char path[LISTEN_PATH_SIZE + sizeof ".listen.lock"];
};

static enum bvhd_status refused(struct bvhd_error *error, const char *path, const char *what)
{
    return bvhd_error_set(error, BVHD_IO, path, "%s: %s", what, strerror(errno));
}

static enum bvhd_status make_address(const char *path, struct sockaddr_un *ret_address, struct bvhd_error *error)
{
    size_t length = strlen(path);
    if (length == 0)
        return bvhd_error_set(error, BVHD_INVALID, "socket", "an empty path");
    if (length >= LISTEN_PATH_SIZE)
        return bvhd_error_set(error, BVHD_INVALID, path, "a socket's path has at most %d bytes; this one has %zu",
                              LISTEN_PATH_SIZE - 1, length);
    *ret_address = (struct sockaddr_un){.sun_family = AF_UNIX};
    memcpy(ret_address->sun_path, path, length + 1);
    return BVHD_OK;
}

/* Opens the lock's file, which must belong to this user alone: a lock on what others can open is theirs to take. */
static enum bvhd_status open_lock(const char *path, int *ret_lock, struct bvhd_error *error)
{
    int lock = open(path, O_RDWR | O_CREAT | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC, 0600);
    if (lock < 0)
        return refused(error, path, "opening the lock");
    struct stat status;
    if (fstat(lock, &status) || !S_ISREG(status.st_mode) || status.st_uid != geteuid() || (status.st_mode & 077)) {
        close(lock);
        return bvhd_error_set(error, BVHD_BUSY, path, "the lock is not a file of this user alone");
    }
    *ret_lock = lock;
    return BVHD_OK;
}

/* The daemon that held the lock before has removed its file, so that others may lock a new one. */
static bool is_current(int lock, const char *path)
{
    struct stat locked, found;
    return !fstat(lock, &locked) && !lstat(path, &found) && locked.st_dev == found.st_dev &&
           locked.st_ino == found.st_ino;
}

/*
 * Locks the file `path`.listen.lock. A daemon holds the lock from checking the socket's file until listening on it,
 * which takes almost no time.
 */
static enum bvhd_status lock_path(const char *path, struct lock *ret_lock, struct bvhd_error *error)
{
    struct lock lock;
    snprintf(lock.path, sizeof lock.path, "%s.listen.lock", path);
    for (int i = 0; i < LOCK_TRIES; i++) {
        enum bvhd_status status = open_lock(lock.path, &lock.file, error);
        if (status != BVHD_OK)
            return status;
        if (!flock(lock.file, LOCK_EX | LOCK_NB) && is_current(lock.file, lock.path)) {
            *ret_lock = lock;
            return BVHD_OK;
        }
        close(lock.file);
        nanosleep(&(struct timespec){.tv_nsec = LOCK_PAUSE_MS * 1000000L}, NULL);
    }
    return bvhd_error_set(error, BVHD_BUSY, lock.path, "another daemon holds the lock");
}

static void unlock(const struct lock *lock)
{
    unlink(lock->path);
    close(lock->file);
}

/* Returns 1 if a process listens at the address, 0 if none does, and -1 (with errno) if it could not be found out. */
static int is_answered(const struct sockaddr_un *address)
{
    int probe = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (probe < 0)
        return -1;
    int answered = 1;
    if (connect(probe, (const struct sockaddr *)address, sizeof *address))
        answered = errno == ECONNREFUSED ? 0 : errno == EAGAIN ? 1 : -1; /* EAGAIN: its queue is full */
    close(probe);
    return answered;
}

static enum bvhd_status clear_path(const struct sockaddr_un *address, struct bvhd_error *error)
{
    const char *path = address->sun_path;
    struct stat status;
    if (lstat(path, &status))
        return errno == ENOENT ? BVHD_OK : refused(error, path, "checking the file");
    if (!S_ISSOCK(status.st_mode))
        return bvhd_error_set(error, BVHD_INVALID, path, "exists already and is not a socket");
    int answered = is_answered(address);
    if (answered > 0)
        return bvhd_error_set(error, BVHD_BUSY, path, "address in use: another daemon answers there");
    if (answered < 0)
        return refused(error, path, "a socket exists there, and connecting to it failed");
    if (unlink(path) && errno != ENOENT)
        return refused(error, path, "removing the socket of a daemon that is gone");
    return BVHD_OK;
}

static enum bvhd_status bind_here(const struct sockaddr_un *address, struct listener *listener,
                                  struct bvhd_error *error)
{
    const char *path = address->sun_path;
    mode_t mask = umask(0177);
    int failed = bind(listener->socket, (const struct sockaddr *)address, sizeof *address);
    umask(mask);
    if (failed)
        return refused(error, path, "binding");
    struct stat status;
    if (lstat(path, &status) || listen(listener->socket, SOMAXCONN)) {
        enum bvhd_status result = refused(error, path, "listening");
        unlink(path);
        return result;
    }
    strcpy(listener->path, path);
    listener->device = status.st_dev;
    listener->inode = status.st_ino;
    return BVHD_OK;
}

enum bvhd_status listen_bind(const char *path, struct listener *ret_listener, struct bvhd_error *error)
{
    struct listener listener = {.socket = -1};
    struct sockaddr_un address;
    struct lock lock;
    enum bvhd_status status = make_address(path, &address, error);
    if (status == BVHD_OK)
        status = lock_path(path, &lock, error);
    if (status != BVHD_OK)
        return status;
    status = clear_path(&address, error);
    if (status == BVHD_OK && (listener.socket = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0)) < 0)
        status = refused(error, path, "creating a socket");
    if (status == BVHD_OK) {
        status = bind_here(&address, &listener, error);
        if (status != BVHD_OK)
            close(listener.socket);
    }
    unlock(&lock);
    if (status == BVHD_OK)
        *ret_listener = listener;
    return status;
}

static bool has_option(int socket, int option, int value)
{
    int found;
    socklen_t size = sizeof found;
    return getsockopt(socket, SOL_SOCKET, option, &found, &size) == 0 && found == value;
}

enum bvhd_status listen_adopt(int socket, struct listener *ret_listener, struct bvhd_error *error)
{
    if (!has_option(socket, SO_DOMAIN, AF_UNIX) || !has_option(socket, SO_TYPE, SOCK_STREAM) ||
        !has_option(socket, SO_ACCEPTCONN, 1))
        return bvhd_error_set(error, BVHD_INVALID, "socket activation", "not a listening Unix stream socket");
    int flags = fcntl(socket, F_GETFL);
    if (flags < 0 || fcntl(socket, F_SETFL, flags | O_NONBLOCK) || fcntl(socket, F_SETFD, FD_CLOEXEC))
        return refused(error, "socket activation", "setting its flags");
    *ret_listener = (struct listener){.socket = socket};
    return BVHD_OK;
}

void listen_close(struct listener *listener)
{
    if (!listener || listener->socket < 0)
        return;
    struct stat status;
    if (*listener->path && !lstat(listener->path, &status) && status.st_dev == listener->device &&
        status.st_ino == listener->inode)
        unlink(listener->path);
    close(listener->socket);
    listener->socket = -1;
}
