/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/socket/inlet.h"

#include <errno.h>
#include <string.h>
#include <sys/socket.h>

#include "daemon/system/release.h"

void inlet_init(struct inlet *inlet, int socket, struct descriptors *descriptors, struct memory *memory)
{
    inlet->socket = socket;
    inlet->descriptors = descriptors;
    frame_parser_init(&inlet->parser, memory, INLET_FIRST_CONTROL, 0);
}

/* Releases descriptors instead of leaving them to the parser, since closing what a client has sent can block. */
static void close_descriptors(struct inlet *inlet, const int *descriptors, uint32_t count)
{
    for (uint32_t i = 0; i < count; i++)
        release_descriptor(descriptors[i]);
    descriptors_give(inlet->descriptors, count);
}

void inlet_finish(struct inlet *inlet)
{
    if (!inlet)
        return;
    close_descriptors(inlet, inlet->parser.descriptors, inlet->parser.descriptor_count);
    inlet->parser.descriptor_count = 0;
    frame_parser_finish(&inlet->parser);
}

void inlet_open(struct inlet *inlet)
{
    inlet->parser.max_control = FRAME_MAX_CONTROL;
    inlet->parser.max_inline = FRAME_MAX_INLINE;
}

/*
 * MOST_AT_ONCE is the most descriptors that the kernel lets through in one message. There is room for all of them,
 * because recvmsg would close the others itself, and that can block for as long as their sender likes (release.h).
 */
enum { MOST_AT_ONCE = 253, DISCARD_SIZE = 16 * 1024 };

struct received {
    ssize_t size; /* the result of recvmsg */
    int number; /* errno */
    uint32_t count; /* of descriptors */
    bool cut; /* more descriptors were sent than were kept */
    int descriptors[MOST_AT_ONCE];
};

static uint32_t received_descriptors(struct msghdr *message, int ret_descriptors[MOST_AT_ONCE])
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

static void receive_message(int socket, void *bytes, uint64_t size, struct received *ret_arrival)
{
    union {
        struct cmsghdr align;
        char bytes[CMSG_SPACE(MOST_AT_ONCE * sizeof(int))];
    } control;
    struct iovec vector = {bytes, size};
    struct msghdr message = {
        .msg_iov = &vector, .msg_iovlen = 1, .msg_control = &control, .msg_controllen = sizeof control};
    ret_arrival->size = recvmsg(socket, &message, MSG_CMSG_CLOEXEC | MSG_DONTWAIT);
    ret_arrival->number = errno;
    ret_arrival->count = ret_arrival->size > 0 ? received_descriptors(&message, ret_arrival->descriptors) : 0;
    ret_arrival->cut = message.msg_flags & MSG_CTRUNC;
}

/* Releases the descriptors beyond those that were counted in advance. No honest client sends as many. */
static void keep_counted(struct received *arrival)
{
    for (; arrival->count > INLET_DESCRIPTORS; arrival->cut = true)
        release_descriptor(arrival->descriptors[--arrival->count]);
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
    close_descriptors(inlet, descriptors, count);
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
    if (!descriptors_take(inlet->descriptors, INLET_DESCRIPTORS, 0))
        return INLET_SHORT;
    struct received arrival;
    receive_message(inlet->socket, at, space, &arrival);
    keep_counted(&arrival);
    descriptors_give(inlet->descriptors, INLET_DESCRIPTORS - arrival.count);
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

enum inlet_result inlet_discard(struct inlet *inlet)
{
    char discarded[DISCARD_SIZE];
    struct received arrival;
    receive_message(inlet->socket, discarded, sizeof discarded, &arrival);
    for (uint32_t i = 0; i < arrival.count; i++)
        release_descriptor(arrival.descriptors[i]);
    if (arrival.size <= 0)
        return arrival.size < 0 ? result_of_error(arrival.number) : INLET_END;
    return INLET_DATA;
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

bool inlet_is_mid_frame(const struct inlet *inlet)
{
    return inlet->parser.begin != inlet->parser.end;
}
