/* SPDX-License-Identifier: MIT
 *
 * kernels.c - sums over the samples of the image-space method; compiled once per level of base/simd.h. The mathematics is in kernels.h and
 * README.md.
 */
#include "methods/image_space/points.h"

#include "render/material_id.h"

enum { AHEAD = 8 };

struct sums {
    int from, to; /* samples */
    vf light[3], weight[3], count;
};

/* R of channel c, interpolated between the two levels of each pixel. */
INLINE vf lerp_levels(const struct is_set *set, const struct shading_point *p, int c, vi at, vf fraction)
{
    enum { NEXT = IS_ROWS * 8 };
    const vi here = at + p->rows[c];
    const vf low = gather(&set->rows[0][c], here) + fraction * gather(&set->rows[0][4 + c], here);
    const vf high = gather(&set->rows[0][c] + NEXT, here) + fraction * gather(&set->rows[0][4 + c] + NEXT, here);

    return low + p->level_fraction[c] * (high - low);
}

/* Adds a sample that hit the surface; `inv_density`: 1/density, or the reciprocal of the sum of densities over views. */
INLINE void add(const struct is_set *set, const struct shading_point *p, const struct surface_hit *f, vf inv_density, bool varies,
                struct sums *s, vi *valid)
{
    const vf square = (f->to[0] * f->to[0] + f->to[1] * f->to[1] + f->to[2] * f->to[2]) * p->per_length2;
    vi good = f->valid & in_table(square);
    vf fraction, weight[3], row[8];
    vi at = find_row(square, &fraction);

    if (varies) {
        for (int c = 0; c < 3; c++)
            weight[c] = lerp_levels(set, p, c, at, fraction) * inv_density;
    } else {
        IN_MEMORY(at);
        gather8(&set->rows[0][0], &at, row);
        for (int c = 0; c < 3; c++)
            weight[c] = (row[c] + fraction * row[4 + c]) * inv_density;
    }
    good &= (inv_density >= 0.0f) & (weight[0] <= IS_WEIGHT_MAX) & (weight[1] <= IS_WEIGHT_MAX) & (weight[2] <= IS_WEIGHT_MAX);
    for (int c = 0; c < 3; c++) {
        s->weight[c] += (vf) ((vi) weight[c] & good);
        s->light[c] += (vf) ((vi) (weight[c] * f->light[c]) & good);
    }
    *valid |= good;
}

INLINE vf jacobian_factor(const struct is_work *w, vf jacobian)
{
    return !w->jacobian ? splat(1.0f) : w->inverted ? 1.0f / jacobian : jacobian;
}

/* Sample k: its position in the plane of samples, mm, and 1/density. `offset`: the samples of the pixels' row of the tile or, if each pixel
 * has its own, of the set. */
INLINE void load_sample(const struct shading_point *p, const float *offset, int k, bool varies, vf *x, vf *y, vf *inv_density)
{
    offset += (size_t) k * 3 * IS_BLOCK;
    *x = (varies ? gather(offset, p->offset) : load(offset)) * p->strength;
    *y = (varies ? gather(offset + IS_BLOCK, p->offset) : load(offset + IS_BLOCK)) * p->strength;
    *inv_density = varies ? gather(offset + 2 * IS_BLOCK, p->offset) : load(offset + 2 * IS_BLOCK);
}

INLINE void in_plane(const struct shading_point *p, vf x, vf y, vf o[3])
{
    for (int k = 0; k < 3; k++)
        o[k] = x * p->s[k] + y * p->q[k];
}

/* Sums over the samples of pixels of one material, in the camera's image only. The texels of a wide profile are spread over the outer cache
 * levels: prefetching them AHEAD samples at a time saves a fifth of the time. */
INLINE void sample_camera(const struct is_work *w, const struct shading_point *p, const struct is_set *set, const float *offset,
                          bool parallel, bool varies, struct sums *s)
{
    struct projection projections[AHEAD];

    for (int from = s->from; from < s->to; from += AHEAD) {
        const int count = s->to - from < AHEAD ? s->to - from : AHEAD;
        vf o[3], x, y, inv_density;
        for (int k = 0; k < count; k++) {
            load_sample(p, offset, from + k, varies, &x, &y, &inv_density);
            in_plane(p, x, y, o);
            project_to_camera(w, p, o, parallel, &projections[k]);
        }
        for (int k = 0; k < count; k++)
            for (int l = 0; l < WIDTH; l++)
                __builtin_prefetch(w->texels + projections[k].at[l]);
        for (int k = 0; k < count; k++) {
            struct surface_hit f;
            vi valid = { 0 };
            load_sample(p, offset, from + k, varies, &x, &y, &inv_density);
            in_plane(p, x, y, o);
            find_in_camera(w, p, o, parallel, &projections[k], &f);
            f.valid &= p->active & (inv_density > 0.0f);
            add(set, p, &f, inv_density * jacobian_factor(w, f.jacobian), varies, s, &valid);
            s->count += select(valid, splat(1.0f), splat(0.0f));
        }
    }
}

/* The same with the views of lights, combined by the balance heuristic. */
INLINE void sample_all(const struct is_work *w, const struct shading_point *p, const struct is_set *set, const float *offset, bool parallel,
                       bool varies, const struct views *views, struct sums *s)
{
    for (int k = s->from; k < s->to; k++) {
        vi valid = { 0 };
        vf x, y, inv_density;
        load_sample(p, offset, k, varies, &x, &y, &inv_density);
        for (int v = 0; v <= w->num_views; v++) {
            struct surface_hit f;
            vf sum;
            if (v == 0) {
                struct projection projection;
                vf o[3];
                in_plane(p, x, y, o);
                project_to_camera(w, p, o, parallel, &projection);
                find_in_camera(w, p, o, parallel, &projection, &f);
            } else {
                find_in_light(&views->image[v], &views->plane[v], p, x, y, &f);
            }
            f.valid &= p->active & (inv_density > 0.0f);
            if (!any(f.valid))
                continue;
            sum = 1.0f / (inv_density * jacobian_factor(w, f.jacobian));
            for (int u = 0; u <= w->num_views; u++)
                if (u != v)
                    sum += density_from(w, &views->image[u], &views->plane[u], p, set, varies, f.to);
            add(set, p, &f, 1.0f / sum, varies, s, &valid);
        }
        s->count += select(valid, splat(1.0f), splat(0.0f));
    }
}

/* Offset of the pixels' row of the tile within the samples of a profile. */
INLINE int first_sample(const struct is_work *w, const struct shading_point *p)
{
    return w->tile * p->count->first + p->y % w->tile * p->count->samples;
}

/* The levels of each pixel of a vector. */
INLINE void choose_levels(const struct is_work *w, const struct is_set *set, struct shading_point *p)
{
    const struct pell_frame *in = w->in;
    const float least = sqrtf(1.0f - IS_ALBEDO_MIN), most = sqrtf(1.0f - IS_ALBEDO_MAX);
    const vi at = p->x & p->active;
    vf mean = { 0 }, row[IS_LEVEL];
    vi level;

    for (int c = 0; c < 3; c++) {
        const vf base = gather(in->base[c] + p->y * in->shape.stride, at);
        const vf albedo = vmax(vmin(base, splat(IS_ALBEDO_MAX)), splat(IS_ALBEDO_MIN)); /* NaN becomes the largest */
        const vf coord = IS_LEVEL_COORD(vsqrt(1.0f - albedo), least, most);
        vi low = __builtin_convertvector(vmax(vmin(coord, splat(IS_LEVELS - 1.5f)), splat(0.0f)), vi);
        p->level_fraction[c] = coord - __builtin_convertvector(low, vf);
        p->rows[c] = (low + 1) * (IS_ROWS * 8);
        mean += coord * (1.0f / 3.0f);
    }
    level = nearest(vmax(vmin(mean, splat(IS_LEVELS - 1.0f)), splat(0.0f)));
    p->density = (level + 1) * (IS_ROWS * 8);
    p->offset = ((level + 1) * w->tile * w->samples_row + first_sample(w, p)) * (3 * IS_BLOCK) + (p->x & (IS_BLOCK - 1));
    level *= IS_LEVEL;
    for (int k = 0; k < IS_LEVEL; k++)
        row[k] = gather(&set->level[0][k], level);
    p->uniform = row[IS_UNIFORM_AT];
    p->broad2 = row[IS_BROAD2_AT];
    p->reach2 = row[IS_REACH2_AT];
    for (int c = 0; c < 3; c++)
        p->quarter[c] = row[IS_QUARTER_AT + c];
}

INLINE void sample_range(const struct is_work *w, const struct shading_point *p, const struct is_set *set, const float *offset,
                         bool parallel, const struct views *views, struct sums *s)
{
    const bool varies = set->level && w->in->base[0];

    if (w->num_views > 0)
        sample_all(w, p, set, offset, parallel, varies, views, s);
    else if (varies)
        sample_camera(w, p, set, offset, parallel, true, s);
    else
        sample_camera(w, p, set, offset, parallel, false, s);
}

/* Valid samples of a kind also represent the invalid ones of that kind. */
INLINE void make_up(struct sums *s)
{
    const vf times = select(s->count > 0.0f, (float) (s->to - s->from) / s->count, splat(0.0f));

    for (int c = 0; c < 3; c++)
        s->light[c] *= times;
}

/* `lane`: within the block. */
INLINE void sample(const struct is_work *w, struct shading_point *p, const struct is_set *set, int lane, bool parallel,
                   const struct views *views, struct sums *s)
{
    const float *offset = set->offset + (size_t) first_sample(w, p) * 3 * IS_BLOCK + lane;

    *s = (struct sums) { 0 };
    for (int c = 0; c < 3; c++)
        p->quarter[c] = splat(set->quarter[c]);
    if (set->level && w->in->base[0]) {
        choose_levels(w, set, p);
        offset = set->offset;
    }
    for (int from = 0; from < p->count->samples;) { /* samples of one kind, or all */
        const bool first = w->renormalise == IS_BY_COUNT && from < w->first_kind && w->first_kind < p->count->samples;
        struct sums kind = { .from = from, .to = first ? w->first_kind : p->count->samples };
        sample_range(w, p, set, offset, parallel, views, &kind);
        if (w->renormalise == IS_BY_COUNT)
            make_up(&kind);
        for (int c = 0; c < 3; c++) {
            s->light[c] += kind.light[c];
            s->weight[c] += kind.weight[c];
        }
        s->count += kind.count;
        from = kind.to;
    }
}

/* The pixels of a vector: rays, planes, tangents. */
INLINE void start(const struct is_work *w, int x, int y, bool parallel, struct shading_point *p)
{
    const ptrdiff_t at = y * w->stride + x;
    const float f = w->focal_px, py = ((float) y + 0.5f - w->mid_y) / f;
    const vf here = load(w->w + at), gu = load(w->gu + at) * f, gv = load(w->gv + at) * f;
    vf px = { 0 };
    vi column = { 0 };

    for (int k = 0; k < WIDTH; k++) {
        px[k] = ((float) (x + k) + 0.5f - w->mid_x) / f;
        column[k] = x + k;
    }
    p->x = column;
    p->y = y;
    p->key = load(w->key + at);
    p->z = parallel ? here : 1.0f / here;
    p->t[0] = parallel ? splat(0.0f) : px;
    p->t[1] = parallel ? splat(0.0f) : splat(py);
    p->at[0] = parallel ? px : px * p->z;
    p->at[1] = parallel ? splat(py) : py * p->z;
    p->at[2] = p->z;
    p->n[0] = gu;
    p->n[1] = gv;
    p->n[2] = parallel ? splat(-1.0f) : here - gu * px - gv * py;
    p->h = vsqrt(p->n[0] * p->n[0] + p->n[1] * p->n[1] + p->n[2] * p->n[2]);
    p->per_h = 1.0f / p->h;
    for (int k = 0; k < 3; k++)
        p->n[k] *= p->per_h;
    tangents(p->n, p->s, p->q);
    p->offset = p->density = (vi) { 0 };
    p->uniform = p->broad2 = p->reach2 = splat(0.0f);
    for (int c = 0; c < 3; c++) {
        p->rows[c] = (vi) { 0 };
        p->level_fraction[c] = splat(0.0f);
    }
}

/* Weight of each channel in the reconstruction: 0 if a quarter of its light stays within half a pixel. */
INLINE vf reconstruction_weight(const struct shading_point *p, int c, bool parallel, float f)
{
    const vf px = p->quarter[c] * p->strength * (parallel ? splat(f) : f / p->z);
    const vf t = vmax(vmin((px - IS_RECONSTRUCT_FROM) / (IS_RECONSTRUCT_TO - IS_RECONSTRUCT_FROM), splat(1.0f)), splat(0.0f));
    return IS_RECONSTRUCT(t);
}

INLINE void finish(const struct is_work *w, const struct shading_point *p, const struct is_set *set, const struct sums *s, int lane,
                   bool parallel, float (*result)[IS_BLOCK], float (*alpha)[IS_BLOCK])
{
    const float *own = w->texels + IS_TEXEL * (p->y * w->texel_stride);
    const vi at = (p->x & p->active) * IS_TEXEL;

    for (int c = 0; c < 3; c++) {
        const vf here = gather(own + IS_RED + c, at);
        vf light = s->light[c];
        vi kept = p->strength > IS_STRENGTH_MIN;
        if (w->renormalise == IS_BY_WEIGHT) {
            kept &= s->weight[c] > 1e-20f;
            light /= s->weight[c];
        } else if (w->renormalise == IS_BY_COUNT) {
            kept &= s->count > 0.0f;
        }
        light = select(kept, light, here) * (set->scale[c] * w->factor);
        store(result[c] + lane, select(p->active, light, load(result[c] + lane)));
        store(alpha[c] + lane,
              select(p->active, (vf) ((vi) reconstruction_weight(p, c, parallel, w->focal_px) & kept), load(alpha[c] + lane)));
    }
}

INLINE int gather_block(const struct is_work *w, int block, int y, bool parallel, const struct image *images)
{
    const struct pell_frame *in = w->in;
    const ptrdiff_t row = y * in->shape.stride;
    _Alignas(64) float result[3][IS_BLOCK] = { { 0 } }, alpha[3][IS_BLOCK] = { { 0 } }, strength[IS_BLOCK];
    _Alignas(64) int32_t index[IS_BLOCK];
    int count = 0;

    if (block >= in->rect.x0 && block + IS_BLOCK <= in->rect.x1) { /* whole vectors: a vector load from partial stores would stall */
        for (int l = 0; l < IS_BLOCK; l++)
            index[l] = pell_material_id(in, row + block + l);
        for (int l = 0; l < IS_BLOCK; l++)
            strength[l] = in->strength ? in->strength[row + block + l] : 1.0f;
    } else {
        for (int l = 0; l < IS_BLOCK; l++) {
            const int x = block + l;
            const bool inside = x >= in->rect.x0 && x < in->rect.x1;
            index[l] = inside ? pell_material_id(in, row + x) : 0;
            strength[l] = index[l] && in->strength ? in->strength[row + x] : 1.0f;
        }
    }
    for (int l = 0; l < IS_BLOCK; l++) {
        strength[l] = strength[l] < 1.0f ? strength[l] : 1.0f; /* NaN becomes 1 */
        strength[l] = strength[l] > 0.0f ? strength[l] : 0.0f;
        count += index[l] != 0;
    }
    if (count == 0)
        return 0;
    for (int l = 0; l < IS_BLOCK; l += WIDTH) {
        struct samples_plane planes[IS_VIEWS];
        const struct views views = { images, planes };
        struct shading_point p;
        vi which, left;
        memcpy(&which, index + l, sizeof(which));
        left = which != 0;
        if (!any(left))
            continue;
        start(w, block + l, y, parallel, &p);
        p.count = &w->counts[w->classes ? w->classes[y / IS_REGION_Y * w->regions_row + block / IS_REGION_X] : IS_CLASS_OF_ALL];
        p.strength = load(strength + l);
        for (int v = 0; v <= w->num_views && w->num_views > 0; v++)
            make_plane(&images[v], &p, &planes[v]);
        for (int k = 0; k < WIDTH; k++) {
            struct sums s;
            const struct is_set *set;
            if (!left[k])
                continue;
            set = &w->sets[which[k] - 1];
            p.active = which == which[k];
            left &= ~p.active;
            p.per_length2 = set->per_length2 / vmax(p.strength * p.strength, splat(1e-7f));
            sample(w, &p, set, l, parallel, &views, &s);
            finish(w, &p, set, &s, l, parallel, result, alpha);
        }
    }
    if (w->reconstruct) {
        for (int c = 0; c < 3; c++) {
            memcpy(w->light[c] + y * w->stride + block, result[c], sizeof(result[c]));
            memcpy(w->alpha[c] + y * w->stride + block, alpha[c], sizeof(alpha[c]));
        }
        return count;
    }
    for (int c = 0; c < 3; c++)
        for (int l = 0; l < IS_BLOCK; l++)
            if (index[l])
                w->out->light[c][y * in->shape.stride + block + l] = result[c][l];
    return count;
}

INLINE int gather_row(const struct is_work *w, int y, bool parallel)
{
    struct image images[IS_VIEWS];
    int count = 0;

    images[0] = (struct image) { w->texels, w->texel_stride, w->in->rect, parallel, w->focal_px, w->mid_x - 0.5f, w->mid_y - 0.5f, NULL };
    for (int v = 0; v < w->num_views; v++) {
        const struct is_view *from = &w->views[v];
        images[v + 1] = (struct image) {
            from->texels,    from->size, { 0, 0, from->size, from->size }, from->orthographic, from->focal_px, from->centre_px,
            from->centre_px, from
        };
    }
    for (int block = w->in->rect.x0 & ~(IS_BLOCK - 1); block < w->in->rect.x1; block += IS_BLOCK)
        count += gather_block(w, block, y, parallel, images);
    return count;
}

static int is_gather(const struct is_work *w, int y)
{
    return w->in->shape.orthographic ? gather_row(w, y, true) : gather_row(w, y, false);
}

extern const struct is_kernels PELL_SIMD(pell_is_kernels);
const struct is_kernels PELL_SIMD(pell_is_kernels) = {
    .load = PELL_SIMD(is_load),
    .measure = PELL_SIMD(is_measure),
    .gather = is_gather,
    .rebuild = PELL_SIMD(is_rebuild),
};
