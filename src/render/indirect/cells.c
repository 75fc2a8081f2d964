/* SPDX-License-Identifier: MIT
 *
 * cells.c - triangles larger than the distance of samples are subdivided into cells (shared/subdivision.h): four from one, or two where a
 * side is short (Rivara 1984), so that long thin triangles are not cut across, too. Samples are distributed over cells and triangles by
 * area, one per square of the spacing. The cell around a point can be found.
 */
#include "render/indirect/internal.h"

#include "scene/triangle.h"

#define MAX_CUTS (1u << 17)        /* largest number of subdivisions, or the number of samples: with more, cells are larger */
#define MAX_DEPTH 24               /* largest number of times that a side is bisected, over all sides of a triangle */
#define CELL_SIZE 2.0f             /* longest side of a cell, in spacings */
#define MIN_SIDE 0.5f              /* ratio of the shortest side to the longest up to which a triangle is bisected */
#define PLASTIC 0.7548776662466927 /* 1 over the root of x^3 = x + 1: a second low-discrepancy sequence in addition to the golden section */
#define MAX_RATIO 4.0              /* largest ratio of samples to the number requested */

struct cutter {
    struct pell_indirect *in;
    struct indirect_spacing *spacing;
    bool count_only;
    float cell_size; /* longest side of cells, in spacings */
    double count;    /* running sum of areas, in samples, fractional */
    double first;    /* samples placed so far */
    uint32_t mesh, triangle;
    struct pell_vec3 corner[3];
    int sides;
    size_t num_cuts, max_cuts;
    size_t room_cells, room_extra, room_samples;
    enum pell_result res;
};

static struct pell_vec3 position_at(const struct cutter *c, const float at[2])
{
    const struct pell_vec3 *p = c->corner;
    return vec3_mad(vec3_mad(vec3_mul(p[0], 1.0f - at[0] - at[1]), at[0], p[1]), at[1], p[2]);
}

static void grow(struct cutter *c, void **array, size_t count, size_t *room, size_t size)
{
    if (c->res == PELL_OK)
        c->res = pell_grow(c->in->ctx, array, count, room, size);
}

static void add_sample(struct cutter *c, float u, float v, float spacing, bool back)
{
    struct pell_indirect *in = c->in;
    const struct pell_mesh *mesh = &in->p.scene->meshes[c->mesh];
    const struct indirect_point point = indirect_point_at(mesh, c->triangle, u, v);
    const struct pell_vec3 n = vec3_normalize(pell_triangle_cross(c->corner));
    const float side = back ? -1.0f : 1.0f;

    grow(c, (void **) &in->samples, in->num_samples + 1, &c->room_samples, sizeof(*in->samples));
    if (c->res == PELL_OK && in->num_samples < INDIRECT_SAMPLES_MOST)
        in->samples[in->num_samples++] = (struct indirect_sample) {
            .mesh = c->mesh,
            .triangle = c->triangle,
            .u = u,
            .v = v,
            .position = point.position,
            .normal = vec3_mul(n, side),
            .smooth = vec3_mul(vec3_normalize(point.normal), side),
            .spacing = spacing,
            .medium = in->same[mesh->material],
            .back = back,
        };
}

/* Places the samples of a piece of `area` mm^2. Each sample represents one unit of the running sum of areas and is in the middle of its
 * unit, which gives its position along the piece's first side; the position across follows the golden section. In undivided triangles of
 * less than one sample, the position in the sum follows the golden section and the one across the second sequence: in rows of triangles
 * of a few samples' size, middles would be at the same height in all triangles. */
static void spread_samples(struct cutter *c, const float corner[3][2], bool is_root, double area, float spacing)
{
    const double before = c->count, wanted = area / ((double) spacing * (double) spacing), most = MAX_RATIO * c->in->p.samples;
    const bool small = is_root && wanted < 1.0;

    c->count = before + wanted;
    while (!c->count_only && c->res == PELL_OK && c->first < most) {
        const double golden = PELL_GOLDEN_SECTION * c->first, plastic = PLASTIC * c->first, section = c->first + golden - floor(golden);
        const double point = small && section >= before ? section : fmax(c->first + 0.5, before);
        const double f = fmin((point - before) / wanted, 1.0), g = small ? plastic - floor(plastic) : golden - floor(golden);
        float a, b, at[2];
        if (!(point < c->count))
            break;
        pell_triangle_point((float) f, (float) g, &a, &b);
        for (int k = 0; k < 2; k++)
            at[k] = (1.0f - a - b) * corner[0][k] + a * corner[1][k] + b * corner[2][k];
        for (int side = 0; side < c->sides; side++)
            add_sample(c, at[0], at[1], spacing, side == 1);
        c->first += 1.0;
    }
}

static uint32_t add_knot(struct cutter *c, const float at[2])
{
    struct pell_indirect *in = c->in;

    grow(c, (void **) &in->extra, in->num_extra + 1, &c->room_extra, sizeof(*in->extra));
    if (c->res != PELL_OK)
        return 0;
    in->extra[in->num_extra] = (struct indirect_knot) { c->mesh, c->triangle, at[0], at[1] };
    return (uint32_t) (in->num_mesh_knots + in->num_extra++);
}

/* Corners of cells, in their triangle, and the knots there. */
struct corners {
    float at[3][2];
    uint32_t knot[3];
};

/* Which corner of a subdivided cell is corner `slot` of a child; 3 + k: the midpoint of the side opposite corner k. */
static int corner_of(uint32_t pattern, int child, int slot)
{
    const int opposite = (int) pattern - 1;

    if (pattern == 0)
        return child == 3 ? 3 + slot : child == slot ? slot : 3 + (3 - child - slot);
    return slot == (opposite + 2 - child) % 3 ? 3 + opposite : slot;
}

/* Chooses the pattern of subdivision by the lengths of the sides; side k is opposite corner k. */
static uint32_t choose_pattern(const float side[3])
{
    const int longest = side[0] >= side[1] && side[0] >= side[2] ? 0 : side[1] >= side[2] ? 1 : 2;
    const float shortest = fminf(side[0], fminf(side[1], side[2]));

    return shortest > MIN_SIDE * side[longest] ? 0 : 1 + (uint32_t) longest;
}

/* Finds the corners of the children, and adds the knots at the midpoints. */
static void make_children(struct cutter *c, const struct corners *parent, uint32_t pattern, int count, struct corners *child)
{
    float at[6][2];
    uint32_t knot[6] = { 0 };

    for (int i = 0; i < 3; i++) {
        for (int k = 0; k < 2; k++) {
            at[i][k] = parent->at[i][k];
            at[3 + i][k] = 0.5f * (parent->at[(i + 1) % 3][k] + parent->at[(i + 2) % 3][k]);
        }
        knot[i] = parent->knot[i];
        if (!c->count_only && (pattern == 0 || (int) pattern - 1 == i))
            knot[3 + i] = add_knot(c, at[3 + i]);
    }
    for (int n = 0; n < count; n++)
        for (int i = 0; i < 3; i++) {
            const int k = corner_of(pattern, n, i);
            child[n].at[i][0] = at[k][0];
            child[n].at[i][1] = at[k][1];
            child[n].knot[i] = knot[k];
        }
}

/* Subdivides a piece that is too large. `cell`: its index, or INDIRECT_NONE if it is the undivided triangle, which gets a cell if it is
 * subdivided. Returns its index. */
static uint32_t subdivide(struct cutter *c, const struct corners *piece, uint32_t cell, int depth)
{
    const float(*at)[2] = piece->at;
    const float centre[2] = { (at[0][0] + at[1][0] + at[2][0]) / 3.0f, (at[0][1] + at[1][1] + at[2][1]) / 3.0f };
    const struct pell_vec3 p[3] = { position_at(c, at[0]), position_at(c, at[1]), position_at(c, at[2]) };
    const float spacing = indirect_spacing_at(c->spacing, position_at(c, centre));
    struct pell_indirect *in = c->in;
    struct corners child[4];
    float side[3], longest;
    uint32_t pattern, first_child;
    int count;

    for (int i = 0; i < 3; i++)
        side[i] = vec3_length(vec3_sub(p[(i + 1) % 3], p[(i + 2) % 3]));
    longest = fmaxf(side[0], fmaxf(side[1], side[2]));
    if (!(longest > c->cell_size * spacing) || depth >= MAX_DEPTH || c->num_cuts == c->max_cuts || c->res != PELL_OK) {
        spread_samples(c, at, depth == 0, 0.5 * (double) vec3_length(pell_triangle_cross(p)), spacing);
        return cell;
    }
    c->num_cuts++;
    pattern = choose_pattern(side);
    count = pattern == 0 ? 4 : 2;
    make_children(c, piece, pattern, count, child);
    depth += pattern == 0 ? 2 : 1;
    if (c->count_only) {
        for (int i = 0; i < count; i++)
            subdivide(c, &child[i], 0, depth);
        return cell;
    }
    grow(c, (void **) &in->cells, in->num_cells + 5, &c->room_cells, sizeof(*in->cells));
    if (c->res != PELL_OK)
        return cell;
    if (cell == INDIRECT_NONE)
        in->cells[cell = (uint32_t) in->num_cells++] = (struct indirect_cell) { 0, { piece->knot[0], piece->knot[1], piece->knot[2] } };
    first_child = (uint32_t) in->num_cells;
    in->cells[cell].child = first_child | pattern << PELL_CELL_PATTERN_SHIFT;
    in->num_cells += (size_t) count;
    for (int i = 0; i < count; i++)
        in->cells[first_child + (uint32_t) i] = (struct indirect_cell) { 0, { child[i].knot[0], child[i].knot[1], child[i].knot[2] } };
    for (int i = 0; i < count; i++)
        subdivide(c, &child[i], first_child + (uint32_t) i, depth);
    return cell;
}

static void subdivide_mesh(struct cutter *c, uint32_t mesh_index)
{
    struct pell_indirect *in = c->in;
    const struct pell_scene *scene = in->p.scene;
    const struct pell_mesh *mesh = &scene->meshes[mesh_index];
    const uint32_t first = in->meshes[mesh_index].first_knot;

    c->mesh = mesh_index;
    c->sides = scene->materials[mesh->material].opaque ? 2 : 1;
    for (uint32_t t = 0; t < mesh->num_triangles && c->res == PELL_OK; t++) {
        const uint32_t *index = mesh->index + 3 * (size_t) t;
        const struct corners whole = { { { 0.0f, 0.0f }, { 1.0f, 0.0f }, { 0.0f, 1.0f } },
                                       { first + index[0], first + index[1], first + index[2] } };
        uint32_t cell;
        if (pell_cancelled_at(in->ctx, t))
            c->res = PELL_ERR_CANCELLED;
        c->triangle = t;
        for (int i = 0; i < 3; i++)
            c->corner[i] = vec3_load(mesh->position + 3 * (size_t) index[i]);
        if (pell_rays_hide(in->p.rays, mesh_index, t))
            continue;
        if (!(vec3_length(pell_triangle_cross(c->corner)) > 0.0f)) /* its pieces may have nonzero area, by rounding */
            continue;
        cell = subdivide(c, &whole, INDIRECT_NONE, 0);
        if (!c->count_only)
            in->roots[in->meshes[mesh_index].first_root + t] = cell;
    }
}

/* Subdivides all meshes. Returns the number of samples, fractional. */
static double subdivide_all(struct cutter *c)
{
    struct pell_indirect *in = c->in;
    const struct pell_scene *scene = in->p.scene;
    double all = 0.0;

    c->count = c->first = 0.0;
    c->num_cuts = in->num_cells = in->num_extra = in->num_samples = 0;
    for (uint32_t i = 0; i < scene->num_meshes && c->res == PELL_OK; i++) {
        const double before = c->count;
        if (!indirect_shown(scene, &scene->meshes[i]))
            continue;
        subdivide_mesh(c, i);
        all += (c->count - before) * c->sides;
        if (pell_cancelled(in->ctx))
            c->res = PELL_ERR_CANCELLED;
    }
    return all;
}

/* The same with cells as large as the limit on their number requires. */
static double subdivide_within_limit(struct cutter *c)
{
    double count = subdivide_all(c);

    for (; c->res == PELL_OK && c->num_cuts == c->max_cuts; count = subdivide_all(c))
        c->cell_size *= 2.0f;
    return count;
}

enum pell_result indirect_cells_make(struct pell_indirect *in, struct indirect_spacing *spacing)
{
    const struct pell_scene *scene = in->p.scene;
    struct cutter c = { .in = in, .spacing = spacing, .cell_size = CELL_SIZE, .res = PELL_OK };
    uint64_t knots = 0, roots = 0;
    double count;

    if (!(in->meshes = pell_calloc(in->ctx, scene->num_meshes, sizeof(*in->meshes))))
        return PELL_ERR_NOMEM;
    for (size_t i = 0; i < scene->num_meshes; i++) {
        if (knots + scene->meshes[i].num_vertices >= UINT32_MAX / 4 || roots + scene->meshes[i].num_triangles >= UINT32_MAX / 4)
            return pell_error(in->ctx, PELL_ERR_UNSUPPORTED, scene->path, "set bounces to 0", "too many vertices for indirect light");
        in->meshes[i] = (struct indirect_mesh) { .first_knot = (uint32_t) knots, .first_root = (uint32_t) roots };
        knots += scene->meshes[i].num_vertices;
        roots += scene->meshes[i].num_triangles;
    }
    in->num_mesh_knots = (size_t) knots;
    in->num_roots = (size_t) roots;
    if (!(in->roots = pell_alloc_array(in->ctx, in->num_roots, sizeof(*in->roots))))
        return PELL_ERR_NOMEM;
    for (size_t i = 0; i < in->num_roots; i++)
        in->roots[i] = INDIRECT_NONE;
    c.max_cuts = in->p.samples > (int) MAX_CUTS ? (size_t) in->p.samples : MAX_CUTS;
    c.count_only = true; /* the first pass counts samples, so that the second keeps to the requested number */
    count = subdivide_within_limit(&c);
    if (c.res != PELL_OK)
        return c.res;
    if (count > 0.0)
        spacing->scale = (float) sqrt(count / in->p.samples);
    c.count_only = false;
    c.cell_size = CELL_SIZE;
    subdivide_within_limit(&c);
    in->num_knots = in->num_mesh_knots + in->num_extra;
    in->num_values = in->num_knots + in->num_extra;
    for (size_t i = 0; i < scene->num_meshes; i++)
        if (scene->materials[scene->meshes[i].material].opaque) {
            in->meshes[i].first_back = (uint32_t) in->num_values;
            in->num_values += scene->meshes[i].num_vertices;
        }
    return c.res;
}
