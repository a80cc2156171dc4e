/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_frame_socket.c - tests frames and descriptors through a real socket: however the kernel splits and joins reads,
 * each frame gets its own descriptors.
 */
#include "tests/support/unit.h"

#include <errno.h>
#include <sys/socket.h>

#include "tests/support/proto/frames.h"
#include "tests/support/random.h"

enum { ROUNDS = 40, MOST = 100 };

static struct memory memory = {.limit = UINT64_MAX, .fail_after = -1};
static struct frames_stream stream;

struct traffic {
    struct random random;
    int sockets[2];
    size_t starts[MOST + 1]; /* where each frame starts in the stream */
    ino_t inodes[MOST][FRAME_MAX_DESCRIPTORS];
    uint32_t sending; /* the frame that is being sent */
    size_t sent; /* bytes of the stream */
    uint32_t received; /* number of frames */
    struct frame_parser parser;
};

static void make_traffic(struct traffic *traffic, uint64_t seed)
{
    *traffic = (struct traffic){.random = {seed}};
    stream.size = stream.count = 0;
    for (uint32_t i = 0; i < MOST; i++) {
        uint64_t dice = random_next(&traffic->random);
        traffic->starts[i] = stream.size;
        frames_add(&stream, &(struct frame_header){.type = (uint16_t)(dice % 9),
                                                   .descriptors = (uint8_t)(dice / 9 % 3 ? 0 : dice / 27 % 5),
                                                   .control_size = (uint32_t)(dice >> 16) % 300,
                                                   .inline_size = (dice >> 40) % 8 ? 0 : (uint32_t)(dice >> 44) % 30000,
                                                   .request = i + 1});
    }
    traffic->starts[MOST] = stream.size;
    assert_int_equal(socketpair(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0, traffic->sockets), 0);
    frame_parser_init(&traffic->parser, &memory, 4096, FRAME_MAX_INLINE);
}

/*
 * Sends the rest of a frame, with its descriptors if it is the beginning; without descriptors, also the next frames
 * that have none.
 */
static bool send_some(struct traffic *traffic)
{
    if (traffic->sending == MOST)
        return false;
    const struct frame_header *header = &stream.headers[traffic->sending];
    bool begins = traffic->sent == traffic->starts[traffic->sending];
    uint32_t count = begins ? header->descriptors : 0, last = traffic->sending;
    if (random_next(&traffic->random) % 2)
        while (last + 1 < MOST && stream.headers[last + 1].descriptors == 0)
            last++;
    union {
        struct cmsghdr head;
        char space[CMSG_SPACE(FRAME_MAX_DESCRIPTORS * sizeof(int))];
    } control;
    struct iovec part = {stream.bytes + traffic->sent, traffic->starts[last + 1] - traffic->sent};
    struct msghdr message = {.msg_iov = &part, .msg_iovlen = 1};
    int descriptors[FRAME_MAX_DESCRIPTORS];
    for (uint32_t i = 0; i < count; i++)
        descriptors[i] = frames_descriptor(&traffic->inodes[traffic->sending][i]);
    if (count > 0) {
        control.head = (struct cmsghdr){CMSG_LEN(count * sizeof(int)), SOL_SOCKET, SCM_RIGHTS};
        message.msg_control = &control;
        message.msg_controllen = CMSG_SPACE(count * sizeof(int));
        memcpy(CMSG_DATA(&control.head), descriptors, count * sizeof(int));
    }
    ssize_t sent = sendmsg(traffic->sockets[0], &message, MSG_NOSIGNAL);
    for (uint32_t i = 0; i < count; i++)
        close(descriptors[i]);
    assert_true(sent > 0 || errno == EAGAIN);
    traffic->sent += sent > 0 ? (size_t)sent : 0;
    while (traffic->sending < MOST && traffic->sent >= traffic->starts[traffic->sending + 1])
        traffic->sending++;
    return sent > 0;
}

static void check_frame(struct traffic *traffic, const struct frame *frame)
{
    frames_check(&stream, traffic->received, frame);
    for (uint32_t i = 0; i < frame->header.descriptors; i++) {
        struct stat about;
        assert_int_equal(fstat(frame->descriptors[i], &about), 0);
        assert_int_equal(about.st_ino, traffic->inodes[traffic->received][i]);
        close(frame->descriptors[i]);
    }
    traffic->received++;
}

static void take_frames(struct traffic *traffic)
{
    struct frame frame;
    struct bvhd_error error;
    for (;;) {
        bool found;
        if (frame_parser_next(&traffic->parser, &frame, &found, &error) != BVHD_OK)
            fail_msg("%s: %s", error.where, error.text);
        if (!found)
            return;
        check_frame(traffic, &frame);
    }
}

static bool receive_some(struct traffic *traffic)
{
    union {
        struct cmsghdr head;
        char space[CMSG_SPACE(FRAME_QUEUE * sizeof(int))];
    } control;
    unsigned char *at;
    uint64_t size;
    assert_int_equal(frame_parser_space(&traffic->parser, &at, &size, NULL), BVHD_OK);
    uint64_t most = 1 + random_next(&traffic->random) % 3000;
    struct iovec part = {at, random_next(&traffic->random) % 2 && most < size ? most : size};
    struct msghdr message = {
        .msg_iov = &part, .msg_iovlen = 1, .msg_control = &control, .msg_controllen = sizeof control};
    ssize_t received = recvmsg(traffic->sockets[1], &message, MSG_CMSG_CLOEXEC);
    if (received <= 0)
        return false;
    assert_int_equal(message.msg_flags & MSG_CTRUNC, 0);
    int descriptors[FRAME_QUEUE];
    uint32_t count = 0;
    for (struct cmsghdr *head = CMSG_FIRSTHDR(&message); head; head = CMSG_NXTHDR(&message, head)) {
        assert_int_equal(head->cmsg_type, SCM_RIGHTS);
        uint32_t some = (uint32_t)((head->cmsg_len - CMSG_LEN(0)) / sizeof(int));
        memcpy(descriptors + count, CMSG_DATA(head), some * sizeof(int));
        count += some;
    }
    assert_int_equal(frame_parser_feed(&traffic->parser, (uint64_t)received, descriptors, count, NULL), BVHD_OK);
    take_frames(traffic);
    return true;
}

static void descriptors_find_their_frames(void **state)
{
    (void)state;
    static struct traffic traffic;
    int open = open_descriptors();
    for (uint64_t seed = 0; seed < ROUNDS; seed++) {
        make_traffic(&traffic, seed);
        while (traffic.received < MOST) {
            for (uint64_t sends = random_next(&traffic.random) % 12; sends > 0 && send_some(&traffic); sends--)
                ;
            for (uint64_t receives = random_next(&traffic.random) % 12; receives > 0 && receive_some(&traffic);
                 receives--)
                ;
        }
        frame_parser_finish(&traffic.parser);
        close(traffic.sockets[0]);
        close(traffic.sockets[1]);
        assert_int_equal(memory.live, 0);
        assert_int_equal(open_descriptors(), open);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(descriptors_find_their_frames),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
