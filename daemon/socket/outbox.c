/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/socket/outbox.h"

#include <errno.h>
#include <linux/sockios.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <sys/uio.h>

enum {
    BATCH = 16, /* replies in one call of sendmsg */
    SECTIONS = 3, /* of a frame: header, control message, inline bytes */
    LEAST_MESSAGE = 512, /* bytes that the kernel counts for any message at least: its own structs are larger */
    LARGE_BUFFER = 1 << 20, /* of a socket; the kernel takes twice as much, if net.core.wmem_max allows */
};

void outbox_init(struct outbox *outbox, int socket, struct descriptor_share *share, const struct outbox_events *events,
                 void *context)
{
    *outbox = (struct outbox){.socket = socket, .share = share, .events = *events, .context = context};
    outbox->end = &outbox->first;
}

static uint64_t frame_size(const struct reply *reply)
{
    return FRAME_HEADER_SIZE + (uint64_t)reply->header.control_size + reply->header.inline_size;
}

static bool has_descriptor(const struct reply *reply)
{
    return reply->header.descriptors > 0;
}

void outbox_push(struct outbox *outbox, struct reply *reply)
{
    reply->next = NULL;
    *outbox->end = reply;
    outbox->end = &reply->next;
    outbox->replies++;
    outbox->bytes += frame_size(reply);
}

static void remove_first(struct outbox *outbox)
{
    struct reply *reply = outbox->first;
    outbox->first = reply->next;
    if (!outbox->first)
        outbox->end = &outbox->first;
    outbox->replies--;
    outbox->bytes -= frame_size(reply);
    outbox->written = 0;
    outbox->events.done(outbox->context, reply);
}

void outbox_drop(struct outbox *outbox)
{
    while (outbox->first)
        remove_first(outbox);
}

/* Lowers the count of unread descriptors to `unread`, if it is higher. The oldest are read first. */
static void limit_unread(struct outbox *outbox, uint32_t unread)
{
    if (unread >= outbox->unread)
        return;
    uint32_t read = outbox->unread - unread;
    uint64_t bytes = 0;
    for (uint32_t i = 0; i < read; i++)
        bytes += outbox->unread_sizes[i];
    memmove(outbox->unread_sizes, outbox->unread_sizes + read, unread * sizeof *outbox->unread_sizes);
    descriptor_share_read(outbox->share, read);
    outbox->unread = unread;
    outbox->events.read(outbox->context, bytes);
}

void outbox_finish(struct outbox *outbox)
{
    if (!outbox)
        return;
    outbox_drop(outbox);
    limit_unread(outbox, 0);
}

/* Checks how much the client has not read. Returns whether it has read something since the last check. */
static bool check_unread(struct outbox *outbox)
{
    int outstanding;
    if (ioctl(outbox->socket, SIOCOUTQ, &outstanding))
        return false;
    bool moved = outstanding < outbox->outstanding;
    outbox->outstanding = outstanding;
    limit_unread(outbox, (uint32_t)outstanding / LEAST_MESSAGE); /* each descriptor is in a different message */
    return moved;
}

bool outbox_is_unread(struct outbox *outbox)
{
    if (outbox->unread)
        check_unread(outbox);
    return outbox->unread > 0;
}

/* Fills vectors with a frame but for its first `skip` bytes. Returns their number, SECTIONS at most. */
static size_t add_frame(const struct reply *reply, uint64_t skip, unsigned char header[FRAME_HEADER_SIZE],
                        struct iovec *vectors)
{
    frame_header_write(&reply->header, header);
    struct bytes sections[SECTIONS] = {
        {header, FRAME_HEADER_SIZE},
        {reply->control.data, reply->header.control_size},
        {reply->header.inline_size ? reply->blob->bytes : NULL, reply->header.inline_size},
    };
    size_t count = 0;
    for (int i = 0; i < SECTIONS; i++) {
        uint64_t skipped = skip < sections[i].size ? skip : sections[i].size;
        skip -= skipped;
        if (sections[i].size > skipped)
            vectors[count++] =
                (struct iovec){(void *)(uintptr_t)(sections[i].data + skipped), sections[i].size - skipped};
    }
    return count;
}

/* Makes one call of sendmsg, with frames from the first on, up to the next one that has a descriptor. */
static ssize_t send_batch(struct outbox *outbox)
{
    unsigned char headers[BATCH][FRAME_HEADER_SIZE];
    struct iovec vectors[BATCH * SECTIONS];
    size_t count = 0, frames = 0;
    for (const struct reply *reply = outbox->first; reply && frames < BATCH && !(frames && has_descriptor(reply));
         reply = reply->next) {
        count += add_frame(reply, frames ? 0 : outbox->written, headers[frames], vectors + count);
        frames++;
    }
    struct msghdr message = {.msg_iov = vectors, .msg_iovlen = count};
    union {
        struct cmsghdr align;
        char bytes[CMSG_SPACE(sizeof(int))];
    } control;
    if (has_descriptor(outbox->first) && outbox->written == 0) {
        memset(&control, 0, sizeof control);
        message.msg_control = &control;
        message.msg_controllen = sizeof control;
        struct cmsghdr *head = CMSG_FIRSTHDR(&message);
        *head = (struct cmsghdr){.cmsg_level = SOL_SOCKET, .cmsg_type = SCM_RIGHTS, .cmsg_len = CMSG_LEN(sizeof(int))};
        memcpy(CMSG_DATA(head), &outbox->first->blob->descriptor, sizeof(int));
    }
    return sendmsg(outbox->socket, &message, MSG_NOSIGNAL | MSG_DONTWAIT);
}

static void count_written(struct outbox *outbox, uint64_t size)
{
    outbox->written += size;
    outbox->sent += size;
    while (outbox->first && outbox->written >= frame_size(outbox->first)) {
        uint64_t rest = outbox->written - frame_size(outbox->first);
        remove_first(outbox);
        outbox->written = rest;
    }
}

static void restore_buffer(struct outbox *outbox)
{
    int half = outbox->send_buffer / 2; /* the kernel doubles the value that it is given */
    if (half)
        setsockopt(outbox->socket, SOL_SOCKET, SO_SNDBUF, &half, sizeof half);
    outbox->send_buffer = 0;
}

void outbox_make_large(struct outbox *outbox)
{
    int size, wanted = LARGE_BUFFER;
    socklen_t length = sizeof size;
    if (outbox->send_buffer) /* it stays small as long as it has to, and becomes large then */
        outbox->send_buffer = outbox->send_buffer < 2 * wanted ? 2 * wanted : outbox->send_buffer;
    else if (!getsockopt(outbox->socket, SOL_SOCKET, SO_SNDBUF, &size, &length) && size < 2 * wanted)
        setsockopt(outbox->socket, SOL_SOCKET, SO_SNDBUF, &wanted, sizeof wanted);
}

/* Makes the socket's send buffer as small as the kernel allows, which raises too small a value to its minimum. */
static void make_buffer_small(struct outbox *outbox)
{
    int size, least = 1;
    socklen_t length = sizeof size;
    if (!outbox->send_buffer && !getsockopt(outbox->socket, SOL_SOCKET, SO_SNDBUF, &size, &length) &&
        !setsockopt(outbox->socket, SOL_SOCKET, SO_SNDBUF, &least, sizeof least))
        outbox->send_buffer = size;
}

/* Counts one more unread descriptor. Returns OUTBOX_EMPTY if it may be sent, else what it has to wait for. */
static enum outbox_state begin_descriptor(struct outbox *outbox, bool *progress)
{
    if (outbox->unread)
        *progress |= check_unread(outbox);
    if (outbox->unread >= OUTBOX_MAX_UNREAD) {
        make_buffer_small(outbox);
        return OUTBOX_UNREAD;
    }
    if (!descriptor_share_send(outbox->share))
        return OUTBOX_WAITING;
    outbox->unread_sizes[outbox->unread++] = outbox->first->blob->size;
    return OUTBOX_EMPTY;
}

static void take_back_descriptor(struct outbox *outbox)
{
    descriptor_share_read(outbox->share, 1);
    outbox->unread--;
}

static enum outbox_state state_of_error(int number)
{
    if (number == EAGAIN || number == EWOULDBLOCK)
        return OUTBOX_BLOCKED;
    return number == ETOOMANYREFS || number == ENOBUFS || number == ENOMEM || number == EINTR ? OUTBOX_WAITING
                                                                                              : OUTBOX_LOST;
}

/* Writes the first reply, and others with it. OUTBOX_EMPTY means that the caller can go on with the rest. */
static enum outbox_state write_some(struct outbox *outbox, bool *progress)
{
    bool begins = has_descriptor(outbox->first) && outbox->written == 0;
    enum outbox_state state = begins ? begin_descriptor(outbox, progress) : OUTBOX_EMPTY;
    if (state)
        return state;
    ssize_t size = send_batch(outbox);
    if (size >= 0) {
        *progress = true;
        count_written(outbox, (uint64_t)size);
        return OUTBOX_EMPTY;
    }
    state = state_of_error(errno);
    if (begins)
        take_back_descriptor(outbox);
    if (state != OUTBOX_BLOCKED || !outbox->send_buffer)
        return state;
    restore_buffer(outbox); /* the small buffer has no room for this frame, so it is tried again with the large one */
    return OUTBOX_EMPTY;
}

enum outbox_state outbox_flush(struct outbox *outbox, bool *ret_progress)
{
    bool progress = false;
    enum outbox_state state = OUTBOX_EMPTY;
    while (!state && outbox->first)
        state = write_some(outbox, &progress);
    if (!state)
        restore_buffer(outbox);
    if ((state && !progress) || (!state && outbox->unread))
        progress |= check_unread(outbox);
    *ret_progress = progress;
    return state;
}
