/* SPDX-License-Identifier: Apache-2.0 */
/*
 * fuzz_config.c - fuzzes the reader of the daemon's configuration file: a file is refused with its line and leaves the
 * options as they were, or every option has a value in its range, and the same file gives the same options again.
 */
#include "tests/fuzz/fuzz.h"

#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "daemon/config.h"

enum { MOST = 64 * 1024 };

/* Returns the path of a file that has these bytes. The next call changes it. */
static const char *path_of(const uint8_t *data, size_t size)
{
    static char path[32];
    static int file = -1;
    if (file < 0) {
        file = memfd_create("bvhd.conf", MFD_CLOEXEC);
        snprintf(path, sizeof path, "/proc/self/fd/%d", file);
    }
    FUZZ_CHECK(file >= 0 && ftruncate(file, 0) == 0);
    FUZZ_CHECK(pwrite(file, data, size, 0) == (ssize_t)size);
    return path;
}

static bool is_path(const char *text)
{
    return memchr(text, 0, CONFIG_PATH_SIZE) != NULL;
}

static void check_ranges(const struct config *config)
{
    FUZZ_CHECK(is_path(config->socket) && is_path(config->cache) && is_path(config->metrics));
    FUZZ_CHECK(config->log_level >= LOG_ERROR && config->log_level <= LOG_DEBUG);
    FUZZ_CHECK(config->max_connections >= 1 && config->service.workers <= POOL_MAX_THREADS);
    FUZZ_CHECK(config->service.memory == 0 || config->service.memory >= SERVICE_LEAST_MEMORY);
    FUZZ_CHECK(config->service.disk_budget == 0 || config->service.disk_budget >= CONFIG_LEAST_DISK);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static const struct config initial = {.log_level = LOG_INFO, .max_connections = 1};
    static struct config first, second;
    struct bvhd_error error = {0};
    const char *path = path_of(data, size < MOST ? size : MOST);
    first = second = initial;
    enum bvhd_status status = config_read_file(path, &first, &error);
    if (status == BVHD_OK) {
        check_ranges(&first);
        FUZZ_CHECK(config_read_file(path, &second, &error) == BVHD_OK);
    } else {
        FUZZ_CHECK(status == BVHD_INVALID && error.status == status && error.where[0] && error.text[0]);
    }
    FUZZ_CHECK(memcmp(&first, &second, sizeof first) == 0);
    return 0;
}

size_t fuzz_sample(uint32_t index, uint8_t *ret_bytes)
{
    static const char *const samples[] = {
        "# a comment\n\nworkers = 4\nmemory = 1G\ncache-size = 512M\n",
        "socket = /run/bvhd/bvhd.sock\ncache = /var/lib/bvhd\ndisk-cache-size = 10G\nmetrics = /run/bvhd/m.sock",
        "max-connections = 1024\nidle-exit = 0\ndrain-timeout = 20.5\nslow-build = 10\nlog-level = debug\n",
        "log-level = loud\n",
        "workers = 0\n",
        "idle-exit = 1e9\n",
        "config = other.conf\n",
        " memory\t=\t16M \r\n",
        "=\n",
    };
    if (index >= sizeof samples / sizeof *samples)
        return 0;
    size_t size = strlen(samples[index]);
    memcpy(ret_bytes, samples[index], size);
    return size;
}
