/* SPDX-License-Identifier: Apache-2.0 */
/*
 * peer.h - the process at the other end of a connection: as log lines and the list of clients name it, and what the
 * descriptors are charged to that it sends.
 */
#ifndef BVHD_PEER_H
#define BVHD_PEER_H

#include "daemon/system/descriptor_share.h"

struct session_peer {
    uint32_t uid;
    int32_t pid;
    uint64_t connection; /* a number that no other connection of this daemon has had, from 1 */
    struct descriptor_share *share; /* of the uid; it outlives the connection, and the descriptors charged to it */
};

/* For log_event: log_event(LOG_INFO, "...", PEER_FORMAT " why=%s", PEER_VALUES(&peer), ...). */
#define PEER_FORMAT "connection=%llu uid=%u pid=%d"
#define PEER_VALUES(peer) (unsigned long long)(peer)->connection, (unsigned)(peer)->uid, (int)(peer)->pid

#endif
