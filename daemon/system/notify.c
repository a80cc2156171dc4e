/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/system/notify.h"

#include <systemd/sd-daemon.h>

_Static_assert(NOTIFY_FIRST_SOCKET == SD_LISTEN_FDS_START, "sockets that are handed over begin at this descriptor");

void notify_ready(const char *status)
{
    sd_notifyf(0, "READY=1\nSTATUS=%s", status);
}

void notify_stopping(const char *status)
{
    sd_notifyf(0, "STOPPING=1\nSTATUS=%s", status);
}

void notify_alive(void)
{
    sd_notify(0, "WATCHDOG=1");
}

uint64_t notify_interval_ms(void)
{
    uint64_t interval_us;
    if (sd_watchdog_enabled(0, &interval_us) <= 0)
        return 0;
    uint64_t half_ms = interval_us / 2000;
    return half_ms ? half_ms : 1;
}

int notify_sockets(void)
{
    return sd_listen_fds(1);
}
