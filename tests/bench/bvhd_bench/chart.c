/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/bench/bvhd_bench/chart.h"

#include <math.h>
#include <string.h>

#include "tests/bench/bvhd_bench/plot.h"

enum { POINTS_MAX = MEASURE_METHODS, LABEL_CHOICES = 26, NEAR_CHOICES = 8 };

/* Families of methods, each with a colour and a shape. */
enum family {
    FAMILY_INDEXED,
    FAMILY_FAST_TRIANGLES,
    FAMILY_LAVAPIPE,
    FAMILY_BY_EMBREE,
    FAMILY_EMBREE,
    FAMILY_EMBREE_ROBUST,
    FAMILY_AUTO,
    FAMILY_OTHER,
    FAMILIES
};

static const struct {
    const char *name, *colour;
    int shape;
} families[FAMILIES] = {
    {"portable, shared vertices", "#0072B2", 7},
    {"portable, 48 B triangles", "#56B4E9", 5},
    {"lavapipe", "#009E73", 9},
    {"portable, built by Embree", "#E69F00", 15},
    {"Embree, default", "#D55E00", 13},
    {"Embree, robust", "#CC79A7", 11},
    {"auto, by rays a triangle", "#000000", 4},
    {"reference", "#000000", 2},
};

/* Whether the method is auto, which builds one of the other tiers. */
static bool is_choice(const struct method *method)
{
    return method->kind == METHOD_OWN && method->quality == QUALITY_AUTO;
}

static enum family family_of(const struct method *method)
{
    if (is_choice(method))
        return FAMILY_AUTO;
    if (method->kind == METHOD_OWN)
        return method->builder == BUILDER_EMBREE   ? FAMILY_BY_EMBREE
               : method->target == TARGET_LAVAPIPE ? FAMILY_LAVAPIPE
               : method->layout_flags              ? FAMILY_FAST_TRIANGLES
                                                   : FAMILY_INDEXED;
    if (method->kind == METHOD_SWEEP)
        return FAMILY_OTHER;
    return method->robust ? FAMILY_EMBREE_ROBUST : FAMILY_EMBREE;
}

struct point {
    double x, y;
    const char *label;
    enum family family;
    bool on_front;
};

struct scatter {
    const char *name, *title, *x_label, *y_label;
    bool low_x, low_y; /* less is better */
    bool tiers_alone; /* leaves out what auto chooses */
    bool y_has_zero; /* the logarithmic axis shows 0 at y_zero */
    double y_zero;
    struct point points[POINTS_MAX];
    uint32_t count;
    double x_range[2], y_range[2];
};

static bool beats(const struct scatter *scatter, const struct point *a, const struct point *b)
{
    double x = scatter->low_x ? b->x - a->x : a->x - b->x, y = scatter->low_y ? b->y - a->y : a->y - b->y;
    return x >= 0 && y >= 0 && (x > 0 || y > 0);
}

static void find_front(struct scatter *scatter)
{
    for (uint32_t i = 0; i < scatter->count; i++) {
        scatter->points[i].on_front = true;
        for (uint32_t k = 0; k < scatter->count; k++)
            if (beats(scatter, &scatter->points[k], &scatter->points[i]))
                scatter->points[i].on_front = false;
    }
}

static void find_range(const struct scatter *scatter, bool is_y, double ret_range[2])
{
    double low = INFINITY, high = 0;
    for (uint32_t i = 0; i < scatter->count; i++) {
        double value = is_y ? scatter->points[i].y : scatter->points[i].x;
        low = fmin(low, value);
        high = fmax(high, value);
    }
    double margin = pow(high / low, 0.1) * 1.08;
    ret_range[0] = low / margin;
    ret_range[1] = high * margin;
}

/* Sorts by increasing x, so that the front can be drawn as a line. */
static void sort_points(struct scatter *scatter)
{
    for (uint32_t i = 1; i < scatter->count; i++)
        for (uint32_t k = i; k > 0 && scatter->points[k - 1].x > scatter->points[k].x; k--) {
            struct point swapped = scatter->points[k];
            scatter->points[k] = scatter->points[k - 1];
            scatter->points[k - 1] = swapped;
        }
}

/* A rectangle, in fractions of the plot's sides. */
struct area {
    double left, bottom, right, top;
};

static bool overlap(const struct area *a, const struct area *b)
{
    return a->left < b->right && b->left < a->right && a->bottom < b->top && b->bottom < a->top;
}

static double share(double value, const double range[2])
{
    return log(value / range[0]) / log(range[1] / range[0]);
}

static struct area area_of_point(const struct scatter *scatter, const struct point *point)
{
    double x = share(point->x, scatter->x_range), y = share(point->y, scatter->y_range);
    return (struct area){x - 0.008, y - 0.013, x + 0.008, y + 0.013};
}

/*
 * The area of a label for one of LABEL_CHOICES places: beside the point, then above or below it, farther away with
 * every choice.
 */
static struct area area_of_label(const struct scatter *scatter, const struct point *point, int choice)
{
    static const double places[NEAR_CHOICES][2] = {{0.014, 0},     {-1.014, 0},     {-0.5, 0.033},   {-0.5, -0.033},
                                                   {0.012, 0.027}, {0.012, -0.027}, {-1.012, 0.027}, {-1.012, -0.027}};
    double width = 0.0083 * (double)strlen(point->label), height = 0.026;
    int far = choice - NEAR_CHOICES;
    double aside = far < 0 ? places[choice][0] : 0.004,
           up = far < 0 ? places[choice][1] : (far % 2 ? -0.028 : 0.028) * (far / 2 + 2);
    double x = share(point->x, scatter->x_range), y = share(point->y, scatter->y_range) + up;
    double left = aside <= -1 ? x - width + aside + 1 : aside < 0 ? x - width / 2 : x + aside;
    return (struct area){left, y - height / 2, left + width, y + height / 2};
}

/* Finds the place where the label hides least. Places outside of the plot are the worst. */
static struct area place_label(const struct scatter *scatter, uint32_t index, const struct area *placed,
                               uint32_t placed_count)
{
    enum { OUTSIDE = 2 * POINTS_MAX };
    struct area best = {0};
    uint32_t least = UINT32_MAX;
    for (int choice = 0; choice < LABEL_CHOICES; choice++) {
        struct area area = area_of_label(scatter, &scatter->points[index], choice);
        uint32_t hidden = OUTSIDE * ((area.left < 0) + (area.right > 1) + (area.bottom < 0) + (area.top > 1));
        for (uint32_t i = 0; i < placed_count; i++)
            hidden += overlap(&area, &placed[i]);
        for (uint32_t i = 0; i < scatter->count; i++) {
            struct area point = area_of_point(scatter, &scatter->points[i]);
            hidden += i != index && overlap(&area, &point);
        }
        if (hidden < least) {
            least = hidden;
            best = area;
        }
    }
    return best;
}

/* Draws a thin line to a label that is not beside its point. */
static void draw_leader(const struct scatter *scatter, const struct point *point, const struct area *label,
                        FILE *script)
{
    double x = share(point->x, scatter->x_range), y = share(point->y, scatter->y_range),
           to = (label->bottom + label->top) / 2;
    if (fabs(to - y) > 0.04)
        fprintf(script, "set arrow from graph %.4f,%.4f to graph %.4f,%.4f nohead lw 0.6 lc rgb \"%s\"\n", x, y, x, to,
                families[point->family].colour);
}

static void draw_labels(const struct scatter *scatter, FILE *script)
{
    struct area placed[POINTS_MAX];
    for (uint32_t i = 0; i < scatter->count; i++) {
        placed[i] = place_label(scatter, i, placed, i);
        draw_leader(scatter, &scatter->points[i], &placed[i], script);
        fprintf(script, "set label ");
        plot_text(script, scatter->points[i].label);
        fprintf(script, " at graph %.4f,%.4f left front font \",9\" textcolor rgb \"%s\"\n", placed[i].left,
                (placed[i].bottom + placed[i].top) / 2, families[scatter->points[i].family].colour);
    }
}

static void draw_data(const struct scatter *scatter, FILE *script)
{
    fprintf(script, "$front << EOD\n");
    for (uint32_t i = 0; i < scatter->count; i++)
        if (scatter->points[i].on_front)
            fprintf(script, "%.6g %.6g\n", scatter->points[i].x, scatter->points[i].y);
    fprintf(script, "EOD\n");
    for (int family = 0; family < FAMILIES; family++) {
        fprintf(script, "$family%d << EOD\n", family);
        for (uint32_t i = 0; i < scatter->count; i++)
            if ((int)scatter->points[i].family == family)
                fprintf(script, "%.6g %.6g\n", scatter->points[i].x, scatter->points[i].y);
        fprintf(script, "EOD\n");
    }
}

static bool has_family(const struct scatter *scatter, int family)
{
    for (uint32_t i = 0; i < scatter->count; i++)
        if ((int)scatter->points[i].family == family)
            return true;
    return false;
}

static void draw_scatter(const void *context, FILE *script)
{
    const struct scatter *scatter = context;
    draw_data(scatter, script);
    fprintf(script, "set title ");
    plot_text(script, scatter->title);
    fprintf(script, " font \",13\"\nset xlabel ");
    plot_text(script, scatter->x_label);
    fprintf(script, "\nset ylabel ");
    plot_text(script, scatter->y_label);
    fprintf(script, "\nset logscale xy\nset xrange [%.6g:%.6g]\nset yrange [%.6g:%.6g]\n", scatter->x_range[0],
            scatter->x_range[1], scatter->y_range[0], scatter->y_range[1]);
    fprintf(script, "set grid xtics ytics mxtics mytics lc rgb \"#d8d8d8\" lw 1, lc rgb \"#ececec\" lw 1\nset bmargin "
                    "6\nset key at screen 0.5,0.03 center horizontal samplen 1 maxrows 2 font \",10\"\n"
                    "set border 3 lc rgb \"#606060\"\nset tics nomirror\n");
    fprintf(script, "set xtics (0.02,0.05,0.1,0.2,0.5,1,2,3,5,7,10,15,20,30,40,50,70,100,150,200)\n");
    if (scatter->y_has_zero)
        fprintf(script, "set ytics (\"0\" %.6g, 10, 100, 1000, 1e4, 1e5, 1e6)\n", scatter->y_zero);
    else
        fprintf(script,
                "set ytics "
                "(0.01,0.02,0.05,0.1,0.2,0.3,0.5,0.7,0.8,0.9,1,1.1,1.2,1.3,1.5,1.7,2,2.5,3,3.5,4,5,7,10,15,20)\n");
    draw_labels(scatter, script);
    fprintf(script, "plot $front with lines lc rgb \"#b0b0b0\" lw 2 dt 2 title \"Pareto front\", $front with points pt "
                    "6 ps 2.2 lw 1.5 lc rgb \"#707070\" notitle");
    for (int family = 0; family < FAMILIES; family++)
        if (has_family(scatter, family))
            fprintf(script, ", $family%d with points pt %d ps 1.3 lc rgb \"%s\" title \"%s\"", family,
                    families[family].shape, families[family].colour, families[family].name);
    fprintf(script, "\n");
}

static void add_point(struct scatter *scatter, const struct method *method, double x, double y)
{
    if (scatter->count < POINTS_MAX && x > 0 && y > 0)
        scatter->points[scatter->count++] =
            (struct point){.x = x, .y = y, .label = method->label, .family = family_of(method)};
}

static bool finish_scatter(struct scatter *scatter, const char *directory)
{
    const struct plot plot = {directory, scatter->name, 1000, 680};
    if (scatter->count < 2)
        return true;
    sort_points(scatter);
    find_front(scatter);
    find_range(scatter, false, scatter->x_range);
    find_range(scatter, true, scatter->y_range);
    if (scatter->y_has_zero) {
        scatter->y_range[0] = scatter->y_zero / 30;
        scatter->y_range[1] = fmax(scatter->y_range[1], scatter->y_zero * 1e3);
    }
    return plot_run(&plot, draw_scatter, scatter);
}

static bool chart_figures(const struct results *results, const char *directory, struct scatter *scatter, enum figure x,
                          enum figure y)
{
    for (uint32_t i = 0; i < results->options->method_count; i++) {
        const struct method *method = results->options->methods[i];
        struct mean along = mean_of(results, method->name, NULL, x), up = mean_of(results, method->name, NULL, y);
        bool is_eight_wide = method->arity == 8;
        if (is_choice(method) && scatter->tiers_alone)
            continue;
        if (along.count > 0 && up.count > 0 && !(y == FIGURE_WORK && (is_eight_wide || method->layout_flags)))
            add_point(scatter, method, along.value, up.value);
    }
    return finish_scatter(scatter, directory);
}

/* Wrong answers per million certain ones; *ret_any says whether there were any certain ones. */
static double wrong_share(const struct results *results, uint32_t method, bool *ret_any)
{
    double wrong = 0, certain = 0;
    for (uint32_t i = 0; i < results->scene_count; i++) {
        const struct verdicts *verdicts = &results->scenes[i].methods[method].verdicts;
        wrong += (double)verdicts_wrong(verdicts);
        certain += (double)(verdicts->rays - verdicts->uncertain);
    }
    *ret_any = certain > 0;
    return certain > 0 ? 1e6 * wrong / certain : 0;
}

static bool chart_errors(const struct results *results, const char *directory)
{
    struct scatter scatter = {.name = "error",
                              .title = "Error against speed: down and right is better",
                              .x_label = "diffuse rays, million a second on one thread (geometric mean over scenes)",
                              .y_label = "certainly wrong answers, a million rays",
                              .low_y = true,
                              .y_has_zero = true,
                              .y_zero = 3};
    for (uint32_t i = 0; i < results->options->method_count; i++) {
        bool any;
        if (is_choice(results->options->methods[i]))
            continue;
        struct mean speed = mean_of(results, results->options->methods[i]->name, NULL, FIGURE_DIFFUSE);
        double wrong = wrong_share(results, i, &any);
        if (any && speed.count > 0)
            add_point(&scatter, results->options->methods[i], speed.value, fmax(wrong, scatter.y_zero));
    }
    return finish_scatter(&scatter, directory);
}

bool chart_results(const struct results *results, const char *directory)
{
    struct scatter speed = {.name = "speed",
                            .title = "Build speed against traced speed: up and right is better",
                            .x_label = "build, million triangles a second on one thread (geometric mean over scenes)",
                            .y_label = "diffuse rays, million a second on one thread"};
    struct scatter work = {.name = "work",
                           .title = "Build speed against what a ray costs: down and right is better",
                           .x_label = "build, million triangles a second on one thread (geometric mean over scenes)",
                           .y_label = "inner steps and triangle tests a diffuse ray, full sweep = 1",
                           .low_y = true,
                           .tiers_alone = true};
    struct scatter bytes = {.name = "bytes",
                            .title = "Bytes against traced speed: up and left is better",
                            .x_label = "bytes a triangle, all that tracing needs (geometric mean over scenes)",
                            .y_label = "diffuse rays, million a second on one thread",
                            .low_x = true,
                            .tiers_alone = true};
    return chart_figures(results, directory, &speed, FIGURE_RATE_ONE, FIGURE_DIFFUSE) &&
           chart_figures(results, directory, &work, FIGURE_RATE_ONE, FIGURE_WORK) &&
           chart_figures(results, directory, &bytes, FIGURE_BYTES, FIGURE_DIFFUSE) &&
           chart_errors(results, directory) && chart_scenes(results, directory);
}
