/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/bench/bvhd_bench/measure.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "tests/bench/bvhd_bench/cell.h"
#include "tests/bench/bvhd_bench/scene_source.h"

enum { FEWEST_RUNS = 3, OVERLAP_SAMPLES = 20000, WORK_RAYS = 20000, CELL_SECONDS = 120 };

/* The state of measuring one scene. */
struct session {
    const struct measure_options *options;
    const char *path;
    struct ply *mesh;
    struct ray_sets rays;
    struct trial trial;
    struct subject subjects[MEASURE_METHODS];
    struct scene_figures *scene;
};

const char *measure_stage_name(int stage)
{
    static const char *const names[MEASURE_STAGES] = {"prepare", "boxes", "split",    "pieces",
                                                      "join",    "depth", "collapse", "write"};
    return names[stage];
}

double measure_rate(const struct scene_figures *scene, const struct figures *figures, int crew)
{
    double ms = statistic_median(&figures->ms[crew]);
    return ms > 0 ? scene->triangles / ms * 1e-3 : 0;
}

/* Tells the user at the terminal which phase begins. */
static void tell(const struct session *session, const char *phase)
{
    fprintf(stderr, "bvhd-bench: %s: %s\n", session->scene->name, phase);
}

/* Finds out in separate processes which methods survive this scene, and how much memory they take. */
static bool try_all(struct session *session)
{
    tell(session, "each method in a process of its own");
    for (uint32_t i = 0; i < session->options->method_count; i++) {
        struct figures *figures = &session->scene->methods[i];
        struct cell_request request = {figures->method->name,  session->path, session->options->size, 0,
                                       session->options->seed, CELL_SECONDS};
        struct cell_result result;
        if (!cell_run(&request, &result))
            return false;
        if (result.outcome != CELL_DONE)
            snprintf(figures->failure, sizeof figures->failure, "%s%s%s", cell_outcome_name(result.outcome),
                     *result.failure ? ": " : "", result.failure);
        figures->peak_resident = result.peak_bytes;
    }
    return true;
}

static bool has_enough(const struct figures *figures, int crew, double patience)
{
    const struct statistic *ms = &figures->ms[crew];
    int most = figures->method->kind == METHOD_SWEEP ? crew : STATISTIC_MAX;
    return ms->count >= most || (ms->count >= FEWEST_RUNS && ms->count * statistic_median(ms) * 1e-3 > patience);
}

static void add_stages(const struct subject *subject, struct statistic *stages)
{
    const struct build_times *ms = &subject->stats.ms;
    const double values[MEASURE_STAGES] = {subject->prepare_ms, ms->boxes,    ms->split, ms->pieces, ms->join,
                                           ms->depth,           ms->collapse, ms->write};
    for (int i = 0; i < MEASURE_STAGES; i++)
        statistic_add(&stages[i], values[i]);
}

static void time_build(struct session *session, struct bench *bench, struct figures *figures, int crew)
{
    struct subject subject;
    if (subject_build(bench, figures->method, session->mesh, (struct subject_wants){0}, &subject)) {
        statistic_add(&figures->ms[crew], subject.ms);
        if (figures->method->kind == METHOD_OWN) {
            session->scene->facts = subject.facts;
            add_stages(&subject, figures->stages[crew]);
        }
        figures->bytes = subject.bytes;
        figures->peak_bytes = subject.peak_bytes;
        figures->stats = subject.stats;
    } else
        snprintf(figures->failure, sizeof figures->failure, "%s", subject.failure);
    subject_finish(&subject);
}

static bool time_builds(struct session *session, int crew)
{
    const struct measure_options *options = session->options;
    struct bench bench;
    if (!bench_start(crew == 0 ? options->threads : 1, &bench))
        return false;
    tell(session, crew == 0 ? "builds on all threads" : "builds on one thread");
    for (int run = 0; run < options->runs; run++)
        for (uint32_t i = 0; i < options->method_count; i++) {
            struct figures *figures = &session->scene->methods[i];
            if (!*figures->failure && !has_enough(figures, crew, options->patience))
                time_build(session, &bench, figures, crew);
        }
    bench_stop(&bench);
    return true;
}

/* Makes the rays, which are the same for all methods, by tracing a build of our own. */
static bool make_rays(struct session *session, struct bench *bench)
{
    struct subject subject;
    bool is_built =
        subject_build(bench, method_find("balanced"), session->mesh, (struct subject_wants){.tracer = true}, &subject);
    if (is_built) {
        session->rays = ray_sets_make(&subject, session->mesh, session->options->picture);
        memcpy(session->scene->ray_counts, session->rays.counts, sizeof session->rays.counts);
    } else
        fprintf(stderr, "bvhd-bench: %s: %s\n", session->path, subject.failure);
    subject_finish(&subject);
    return is_built;
}

/* Traces evenly spaced ones of the diffuse rays. */
static struct tree_work trace_sample(const struct session *session, const struct tree *tree)
{
    const struct ray_sets *rays = &session->rays;
    uint32_t all = rays->counts[RAYS_DIFFUSE], count = all < WORK_RAYS ? all : WORK_RAYS;
    struct ray *sample = tree_need(count, sizeof *sample);
    for (uint32_t i = 0; i < count; i++)
        sample[i] = rays->rays[RAYS_DIFFUSE][(uint64_t)i * all / count];
    struct tree_work work = tree_trace(tree, session->mesh, sample, count);
    free(sample);
    return work;
}

static void look_at_tree(struct session *session, struct subject *subject, struct figures *figures)
{
    figures->sah = tree_sah(&subject->tree);
    figures->depth = tree_depth(&subject->tree);
    figures->overlap = tree_overlap(&subject->tree, session->mesh, OVERLAP_SAMPLES);
    figures->refs = (double)subject->tree.ref_count / session->mesh->triangle_count;
    figures->work = trace_sample(session, &subject->tree);
    tree_finish(&subject->tree);
}

/* Builds once more, keeps what rays are traced through, and inspects the trees. */
static void build_tracers(struct session *session, struct bench *bench)
{
    for (uint32_t i = 0; i < session->options->method_count; i++) {
        struct figures *figures = &session->scene->methods[i];
        const struct method *method = figures->method;
        struct subject_wants wants = {.tree = method_has_tree(method) && !session->options->calibrates,
                                      .tracer = method_traces(method)};
        struct subject *subject = &session->subjects[i];
        if (*figures->failure)
            continue;
        if (!subject_build(bench, method, session->mesh, wants, subject))
            snprintf(figures->failure, sizeof figures->failure, "%s", subject->failure);
        else if (wants.tree)
            look_at_tree(session, subject, figures);
    }
}

static double seconds_of_thread(void)
{
    struct timespec now;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static bool has_enough_rays(const struct session *session, uint32_t index, enum ray_kind kind)
{
    const struct statistic *mrays = &session->scene->methods[index].mrays[kind];
    double rate = statistic_median(mrays), seconds = rate > 0 ? 1e-6 * session->rays.counts[kind] / rate : 0;
    return mrays->count >= FEWEST_RUNS && mrays->count * seconds > session->options->patience;
}

static void time_rays(const struct session *session, uint32_t index, enum ray_kind kind)
{
    const struct subject *subject = &session->subjects[index];
    const struct ray *rays = session->rays.rays[kind];
    uint32_t count = session->rays.counts[kind], hits = 0;
    struct ray_hit hit;
    double begin = seconds_of_thread();
    for (uint32_t i = 0; i < count; i++)
        hits += subject_trace(subject, &rays[i], &hit, NULL);
    double spent = seconds_of_thread() - begin;
    if (count > 0 && hits <= count && spent > 0)
        statistic_add(&session->scene->methods[index].mrays[kind], 1e-6 * count / spent);
}

static bool is_traced(const struct figures *figures)
{
    return !*figures->failure && method_traces(figures->method);
}

static void trace_all(struct session *session)
{
    for (int run = 0; run < session->options->runs; run++)
        for (enum ray_kind kind = 0; kind < RAY_KINDS; kind++)
            for (uint32_t i = 0; i < session->options->method_count; i++)
                if (is_traced(&session->scene->methods[i]) && !has_enough_rays(session, i, kind))
                    time_rays(session, i, kind);
}

static void count_steps(struct session *session, uint32_t index)
{
    struct ray_hit hit;
    for (uint32_t i = 0; i < session->rays.counts[RAYS_DIFFUSE]; i++)
        subject_trace(&session->subjects[index], &session->rays.rays[RAYS_DIFFUSE][i], &hit,
                      &session->scene->methods[index].counters);
}

static void judge_all(struct session *session, struct bench *bench)
{
    struct trial trial = trial_make(bench, session->mesh, session->options->seed, session->options->check_rays);
    for (uint32_t i = 0; i < session->options->method_count; i++)
        if (is_traced(&session->scene->methods[i])) {
            session->scene->methods[i].verdicts = verdicts_of(&trial, &session->subjects[i]);
            if (session->scene->methods[i].method->kind == METHOD_OWN)
                count_steps(session, i);
        }
    trial_finish(&trial);
}

static bool trace(struct session *session)
{
    struct bench bench;
    if (!bench_start(1, &bench))
        return false;
    bool is_ready = make_rays(session, &bench);
    if (is_ready) {
        tell(session, "trees");
        build_tracers(session, &bench);
        tell(session, "rays");
        trace_all(session);
    }
    if (is_ready && !session->options->calibrates) {
        tell(session, "brute force");
        judge_all(session, &bench);
    }
    for (uint32_t i = 0; i < session->options->method_count; i++)
        subject_finish(&session->subjects[i]);
    ray_sets_finish(&session->rays);
    bench_stop(&bench);
    return is_ready;
}

bool measure_scene(const char *path, const struct measure_options *options, struct scene_figures *ret_figures)
{
    const char *slash = strrchr(path, '/');
    struct session session = {.options = options, .path = path, .scene = ret_figures};
    session.mesh = scene_source_open(path, options->size, options->seed);
    if (!session.mesh)
        return false;
    ret_figures->name = slash ? slash + 1 : path;
    ret_figures->triangles = session.mesh->triangle_count;
    ret_figures->vertices = session.mesh->vertex_count;
    for (uint32_t i = 0; i < options->method_count; i++)
        ret_figures->methods[i].method = options->methods[i];
    bool is_done = options->calibrates || try_all(&session);
    for (int crew = options->calibrates; crew < MEASURE_CREWS && is_done; crew++)
        is_done = time_builds(&session, crew);
    is_done = is_done && trace(&session);
    ply_free(session.mesh);
    return is_done;
}
