/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/socket/inlet.h"

#include <errno.h>
#include <linux/sockios.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include "daemon/system/release.h"

void inlet_init(struct inlet *inlet, int socket, struct descriptor_share *share, struct memory *memory)
{
    inlet->socket = socket;
    inlet->share = share;
    frame_parser_init(&inlet->parser, memory, INLET_FIRST_CONTROL, 0);
}

/* Releases descriptors instead of leaving them to the parser, since closing what a client has sent can block. */
static void close_descriptors(struct descriptor_share *share, const int *descriptors, uint32_t count)
{
    for (uint32_t i = 0; i < count; i++)
        release_descriptor(share, descriptors[i]);
}

void inlet_finish(struct inlet *inlet)
{
    if (!inlet)
        return;
    close_descriptors(inlet->share, inlet->parser.descriptors, inlet->parser.descriptor_count);
    inlet->parser.descriptor_count = 0;
    frame_parser_finish(&inlet->parser);
}

void inlet_open(struct inlet *inlet)
{
    inlet->parser.max_control = FRAME_MAX_CONTROL;
    inlet->parser.max_inline = FRAME_MAX_INLINE;
}

enum { DISCARD_SIZE = 16 * 1024, CLOSING_READS = 16 /* of what a client has left in its socket */ };

struct received {
    ssize_t size; /* the result of recvmsg */
    int number; /* errno */
    uint32_t count; /* of descriptors */
    bool cut; /* more descriptors were sent than were kept */
    int descriptors[DESCRIPTORS_MESSAGE];
};

static uint32_t received_descriptors(struct msghdr *message, int ret_descriptors[DESCRIPTORS_MESSAGE])
{
    uint32_t count = 0;
    for (struct cmsghdr *head = CMSG_FIRSTHDR(message); head; head = CMSG_NXTHDR(message, head))
        if (head->cmsg_level == SOL_SOCKET && head->cmsg_type == SCM_RIGHTS) {
            size_t size = head->cmsg_len - CMSG_LEN(0);
            memcpy(ret_descriptors + count, CMSG_DATA(head), size);
            count += (uint32_t)(size / sizeof(int));
        }
    return count;
}

/*
 * Receives one message. The descriptors that come with it are counted and charged to the share. Returns false, and
 * receives nothing, if there might be no room for them.
 */
static bool receive_message(int socket, struct descriptor_share *share, void *bytes, uint64_t size,
                            struct received *ret_arrival)
{
    if (!descriptor_share_has_room(share, INLET_DESCRIPTORS) ||
        !descriptors_take(share->descriptors, DESCRIPTORS_MESSAGE, DESCRIPTORS_OWN))
        return false;
    union {
        struct cmsghdr align;
        char bytes[CMSG_SPACE(DESCRIPTORS_MESSAGE * sizeof(int))];
    } control;
    struct iovec vector = {bytes, size};
    struct msghdr message = {
        .msg_iov = &vector, .msg_iovlen = 1, .msg_control = &control, .msg_controllen = sizeof control};
    ret_arrival->size = recvmsg(socket, &message, MSG_CMSG_CLOEXEC | MSG_DONTWAIT);
    ret_arrival->number = errno;
    ret_arrival->count = ret_arrival->size > 0 ? received_descriptors(&message, ret_arrival->descriptors) : 0;
    ret_arrival->cut = message.msg_flags & MSG_CTRUNC;
    descriptors_give(share->descriptors, DESCRIPTORS_MESSAGE - ret_arrival->count);
    descriptor_share_add(share, ret_arrival->count);
    return true;
}

/* Releases the descriptors beyond those of one frame. No honest client sends as many. */
static void keep_allowed(struct descriptor_share *share, struct received *arrival)
{
    for (; arrival->count > INLET_DESCRIPTORS; arrival->cut = true)
        release_descriptor(share, arrival->descriptors[--arrival->count]);
}

static enum inlet_result result_of_error(int number)
{
    if (number == EAGAIN || number == EWOULDBLOCK || number == EINTR)
        return INLET_NOTHING;
    return number == ENOBUFS || number == ENOMEM ? INLET_SHORT : INLET_END;
}

/*
 * Hands the bytes and descriptors that were read to the parser. The descriptors then belong to it, also after an error.
 */
static enum bvhd_status feed(struct inlet *inlet, uint64_t size, const int *descriptors, uint32_t count,
                             struct bvhd_error *error)
{
    if (count <= FRAME_QUEUE - inlet->parser.descriptor_count)
        return frame_parser_feed(&inlet->parser, size, descriptors, count, error);
    close_descriptors(inlet->share, descriptors, count);
    return bvhd_error_set(error, BVHD_TOO_LARGE, "frame.descriptors", "more than %d descriptors wait for their frames",
                          FRAME_QUEUE);
}

static enum inlet_result receive(struct inlet *inlet, uint64_t *ret_size, struct bvhd_error *error)
{
    unsigned char *at;
    uint64_t space;
    enum bvhd_status status = frame_parser_space(&inlet->parser, &at, &space, error);
    if (status != BVHD_OK)
        return status == BVHD_NO_MEMORY ? INLET_SHORT : INLET_BROKEN;
    struct received arrival;
    if (!receive_message(inlet->socket, inlet->share, at, space, &arrival))
        return INLET_SHORT;
    keep_allowed(inlet->share, &arrival);
    if (arrival.size <= 0)
        return arrival.size < 0 ? result_of_error(arrival.number) : INLET_END;
    *ret_size = (uint64_t)arrival.size;
    if (feed(inlet, (uint64_t)arrival.size, arrival.descriptors, arrival.count, error) != BVHD_OK)
        return INLET_BROKEN;
    if (arrival.cut) {
        bvhd_error_set(error, BVHD_TOO_LARGE, "frame.descriptors", "more than %d descriptors at once",
                       INLET_DESCRIPTORS);
        return INLET_BROKEN;
    }
    return (uint64_t)arrival.size < space ? INLET_LAST : INLET_DATA;
}

enum inlet_result inlet_read(int socket, struct descriptor_share *share, void *bytes, uint64_t size, uint64_t *ret_size)
{
    struct received arrival;
    if (!receive_message(socket, share, bytes, size, &arrival))
        return INLET_SHORT;
    close_descriptors(share, arrival.descriptors, arrival.count);
    if (arrival.size <= 0)
        return arrival.size < 0 ? result_of_error(arrival.number) : INLET_END;
    *ret_size = (uint64_t)arrival.size;
    return INLET_DATA;
}

enum inlet_result inlet_discard(int socket, struct descriptor_share *share)
{
    char discarded[DISCARD_SIZE];
    uint64_t size;
    return inlet_read(socket, share, discarded, sizeof discarded, &size);
}

static bool has_unread(int socket)
{
    int bytes;
    return ioctl(socket, SIOCINQ, &bytes) != 0 || bytes != 0;
}

/* Discards what is unread in a socket that was shut down. Returns whether nothing is left. */
static bool empty_socket(int socket, struct descriptor_share *share)
{
    int reads = 0;
    while (has_unread(socket))
        if (reads++ == CLOSING_READS || inlet_discard(socket, share) != INLET_DATA)
            return false;
    return true;
}

void inlet_close_socket(int socket, struct descriptor_share *share)
{
    shutdown(socket, SHUT_RDWR);
    if (empty_socket(socket, share)) {
        close(socket);
        descriptor_share_give(share, 1);
    } else {
        release_descriptor(share, socket);
    }
}

uint64_t inlet_capacity(const struct inlet *inlet)
{
    return inlet->parser.capacity;
}

uint64_t inlet_wanted(const struct inlet *inlet)
{
    return frame_parser_wanted(&inlet->parser);
}

enum inlet_result inlet_receive(struct inlet *inlet, uint64_t *ret_size, struct bvhd_error *error)
{
    *ret_size = 0;
    return receive(inlet, ret_size, error);
}

enum bvhd_status inlet_next(struct inlet *inlet, struct frame *ret_frame, bool *ret_found, struct bvhd_error *error)
{
    return frame_parser_next(&inlet->parser, ret_frame, ret_found, error);
}

bool inlet_is_mid_frame(const struct inlet *inlet, uint64_t *ret_begin)
{
    uint64_t have = inlet->parser.end - inlet->parser.begin;
    *ret_begin = inlet->parser.fed - have;
    return have > 0;
}
