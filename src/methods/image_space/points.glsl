// SPDX-License-Identifier: MIT
// points.glsl - surface points hit by samples, in the camera's irradiance image and in those of lights, and the sampling density of each
// view there: mirror of points.h. Vectors are in the camera's frame: x right, y down, z forward, mm.
//
// sets, 4 per material, bits of floats unless noted: 1/length^2, R'^2, p_u, broad^2 (struct is_set); scale of the channels, int: first of
// its offsets; mm with a quarter of a channel's light, int: first of its rows; int: first of its levels or -1, median radius in mm, 0, 0.
// Per level 2: p_u, broad^2, R'^2, mm with a quarter of red; of green, of blue, 0, 0. views, 4 each: the rows of the rotation from the
// camera's frame, each with the shift; focal length, centre (px), 1: parallel, 0.

struct ShadingPoint {
    float key, z, per_h;
    vec2 t;           // of the ray
    vec3 at, n, s, q; // x_o; unit: normal, tangents
    ivec2 pixel;
    float strength, per_length2; // 1/(length strength)^2
    float uniform_density, broad2, reach2;
    vec3 quarter, scale;
    int samples;
    float importance, others; // number of samples of the two kinds
    int offset, rows; // first of its samples, first of its densities
    // With levels of its own:
    bool varies;
    ivec3 channel_rows;
    vec3 level_fraction; // fraction toward the next level
};

// A sample's hit on the surface.
struct SurfaceHit {
    bool valid;
    vec3 to;        // p - x_o
    float jacobian; // dA_p/dA_p'
    vec3 light;
};

// The plane through x_o of a view's samples, in the view's frame.
struct SamplesPlane {
    vec3 n, s, q, at;
    float dist; // from the centre of projection; parallel view: cosine with it
};

float within(float x)
{
    const float low = x < IS_FAR_PX ? x : IS_FAR_PX;
    return low > -IS_FAR_PX ? low : -IS_FAR_PX;
}

int nearest(float x)
{
    return int(floor(x + 0.5));
}

// The row of a squared radius, in units of length^2, and the fraction toward the next.
int find_row(float square, out float fraction)
{
    const float low = square < IS_SQUARE_LAST ? square : IS_SQUARE_LAST;
    const int bits = floatBitsToInt(low > IS_SQUARE_MIN ? low : IS_SQUARE_MIN);

    fraction = float(bits & ((1 << IS_SHIFT) - 1)) * (1.0 / float(1 << IS_SHIFT));
    return ((bits >> IS_SHIFT) - IS_FIRST_ROW) * 2;
}

// Tangents of n, a unit vector (Duff et al. 2017, "Building an Orthonormal Basis, Revisited").
void tangents(vec3 n, out vec3 s, out vec3 q)
{
    const float side = n.z < 0.0 ? -1.0 : 1.0, a = -1.0 / (side + n.z), b = n.x * n.y * a;

    s = vec3(side * n.x * n.x * a + 1.0, side * b, -side * n.x);
    q = vec3(b, n.y * n.y * a + side, -n.y);
}

// --- The pixel ---------------------------------------------------------------------------------------------------------------------

void choose_levels(int first, int pixel, ivec2 tile, inout ShadingPoint p)
{
    const float least = sqrt(1.0 - IS_ALBEDO_MIN), most = sqrt(1.0 - IS_ALBEDO_MAX);
    const int first_rows = p.rows;
    float mean = 0.0;

    for (int c = 0; c < 3; c++) {
        const float low_albedo = base[pixel][c] < IS_ALBEDO_MAX ? base[pixel][c] : IS_ALBEDO_MAX;
        const float albedo = low_albedo > IS_ALBEDO_MIN ? low_albedo : IS_ALBEDO_MIN;
        const float coord = IS_LEVEL_COORD(sqrt(1.0 - albedo), least, most);
        const int low = int(clamp(coord, 0.0, float(IS_LEVELS) - 1.5));
        p.level_fraction[c] = coord - float(low);
        p.channel_rows[c] = first_rows + (low + 1) * 2 * IS_ROWS;
        mean += coord * (1.0 / 3.0);
    }
    const int level = nearest(clamp(mean, 0.0, float(IS_LEVELS) - 1.0));
    const vec4 a = uintBitsToFloat(sets[first + 2 * level]), b = uintBitsToFloat(sets[first + 2 * level + 1]);
    p.varies = true;
    p.rows += (level + 1) * 2 * IS_ROWS;
    p.offset += (level + 1) * pc.tile * pc.tile * pc.row_samples;
    p.uniform_density = a.x;
    p.broad2 = a.y;
    p.reach2 = a.z;
    p.quarter = vec3(a.w, b.xy);
}

// The samples of its class, and the index of the first.
void choose_samples(ivec2 pixel, int row, inout ShadingPoint p)
{
    int of = IS_CLASS_OF_ALL, importance;

    if (pc.adaptive != 0) {
        const int y = (pc.y0 + pixel.y) / IS_REGION_Y - pc.y0 / IS_REGION_Y;
        of = class_at(int(regions[1 + y * regions_x() + pixel.x / IS_REGION_X] >> 8), int(regions[0]));
        for (int k = 0; k < of; k++)
            p.offset += pc.tile * pc.tile * class_samples(k);
    }
    p.samples = class_samples(of);
    p.offset += row * p.samples * pc.tile;
    importance = pc.halves != 0 ? (p.samples + 1) / 2 : pc.importance > 0 ? p.samples : 0;
    p.importance = float(importance);
    p.others = float(p.samples - importance);
}

// `texel_plane`, `h`: of its texel.
ShadingPoint start(ivec2 pixel, vec4 texel_plane, float h)
{
    const int i = pixel_at(pixel), set = 4 * (int(surface[i].x) - 1);
    const uvec4 scale = sets[set + 1], quarter = sets[set + 2];
    const vec4 numbers = uintBitsToFloat(sets[set]);
    const bool parallel = pc.orthographic != 0;
    const vec2 ray = ray_of(pixel);
    const ivec2 tile = (pixel + ivec2(pc.x0, pc.y0)) % pc.tile;
    const float strength = pc.strength != 0 ? uintBitsToFloat(surface[i].y) : 1.0;
    ShadingPoint p;

    p.key = texel_plane.w;
    p.pixel = pixel;
    p.z = parallel ? texel_plane.x : 1.0 / texel_plane.x;
    p.t = parallel ? vec2(0.0) : ray;
    p.at = vec3(parallel ? ray : ray * p.z, p.z);
    p.n = vec3(texel_plane.yz * pc.focal_px, 0.0);
    p.n.z = parallel ? -1.0 : texel_plane.x - p.n.x * ray.x - p.n.y * ray.y;
    p.per_h = 1.0 / sqrt(p.n.x * p.n.x + p.n.y * p.n.y + p.n.z * p.n.z);
    p.n *= p.per_h;
    tangents(p.n, p.s, p.q);
    p.strength = strength < 1.0 ? strength : 1.0; // NaN becomes 1
    p.strength = p.strength > 0.0 ? p.strength : 0.0;
    p.per_length2 = numbers.x / max(p.strength * p.strength, 1e-7);
    p.reach2 = numbers.y;
    p.uniform_density = numbers.z;
    p.broad2 = numbers.w;
    p.scale = uintBitsToFloat(scale.xyz);
    p.quarter = uintBitsToFloat(quarter.xyz);
    p.rows = int(quarter.w);
    p.offset = int(scale.w) + tile.x;
    choose_samples(pixel, tile.y, p);
    p.varies = false;
    p.channel_rows = ivec3(0);
    p.level_fraction = vec3(0.0);
    if (pc.colours != 0 && int(sets[set + 3].x) >= 0)
        choose_levels(int(sets[set + 3].x), i, tile, p);
    return p;
}

// --- The camera's view -------------------------------------------------------------------------------------------------------------

// The visible point on the camera ray through point (x, y), mm, of the tangent plane; everything is relative to the pixel, because radii
// may be far below the precision of a depth.
SurfaceHit find_in_camera(ShadingPoint p, vec2 sampled)
{
    const bool parallel = pc.orthographic != 0;
    const vec3 o = sampled.x * p.s + sampled.y * p.q;
    const float f = pc.focal_px, depth = p.z + o.z, scale = parallel ? f : f / depth;
    const float du = within(scale * (parallel ? o.x : o.x - p.t.x * o.z)), dv = within(scale * (parallel ? o.y : o.y - p.t.y * o.z));
    const ivec2 step = ivec2(nearest(du), nearest(dv)), q = p.pixel + step;
    SurfaceHit hit;

    hit.valid = false;
    if (!is_inside(q) || !(parallel || depth > 0.0))
        return hit;
    const int i = pixel_at(q);
    const vec4 texel_plane = texels[2 * i], texel_light = texels[2 * i + 1];
    if (texel_plane.w != p.key)
        return hit;
    hit.light = texel_light.rgb;
    hit.valid = true;
    hit.to = o;
    hit.jacobian = 1.0;
    if (step == ivec2(0))
        return hit;
    const float plane = IS_PLANE_AT(texel_plane.x, texel_plane.y, texel_plane.z, du - float(step.x), dv - float(step.y));
    const float z = parallel ? plane : 1.0 / plane, length_px = parallel ? 1.0 / f : z * (1.0 / f), ratio = length_px * scale;
    hit.valid = parallel || plane > 0.0;
    hit.jacobian = parallel ? texel_light.w * p.per_h : IS_AREA_RATIO(texel_light.w * p.per_h, ratio);
    hit.to = vec3((z - p.z) * p.t + vec2(du, dv) * length_px, z - p.z);
    return hit;
}

// --- Several views: index 0 is the camera's -----------------------------------------------------------------------------------------

struct View {
    bool parallel;
    float f;
    vec2 middle; // column = f X/Z + middle, of the grid
};

View view_of(int v)
{
    if (v == 0)
        return View(pc.orthographic != 0, pc.focal_px, vec2(pc.mid_x, pc.mid_y) - 0.5 - vec2(pc.x0, pc.y0));
    const vec4 last = views[4 * (v - 1) + 3];
    return View(last.z != 0.0, last.x, last.yy);
}

vec3 into_view(int v, vec3 p, float shifted)
{
    if (v == 0)
        return p;
    const vec4 x = views[4 * (v - 1)], y = views[4 * (v - 1) + 1], z = views[4 * (v - 1) + 2];
    return vec3(dot(x.xyz, p) + shifted * x.w, dot(y.xyz, p) + shifted * y.w, dot(z.xyz, p) + shifted * z.w);
}

// Both halves of the texel of a point, and the offset of the point from its centre; key 0 outside of the image.
void load_texel(int v, View m, vec3 p, out vec2 off, out vec4 texel_plane, out vec4 texel_light)
{
    const float scale = m.parallel ? m.f : m.f / p.z;
    const vec2 uv = vec2(within(scale * p.x + m.middle.x), within(scale * p.y + m.middle.y));
    const ivec2 q = ivec2(nearest(uv.x), nearest(uv.y));
    const ivec2 size = v == 0 ? ivec2(pc.width, pc.height) : ivec2(pc.view_size);

    texel_plane = texel_light = vec4(0.0);
    off = uv - vec2(q);
    if (q.x < 0 || q.y < 0 || q.x >= size.x || q.y >= size.y || !(m.parallel || p.z > 0.0))
        return;
    const int i = ((v == 0 ? 0 : (v - 1) * size.y) + q.y) * size.x + q.x;
    if (v == 0) {
        texel_plane = texels[2 * i];
        texel_light = texels[2 * i + 1];
    } else {
        texel_plane = lights[2 * i];
        texel_light = lights[2 * i + 1];
    }
}

// dA_p/dA_p' for a point at `ratio` = z/z'.
float jacobian_of(View m, float texel_h, float ratio, float dist)
{
    const float h = texel_h * abs(dist);
    return m.parallel ? h : IS_AREA_RATIO(h, ratio);
}

// Tangent plane for the camera, as in the paper; perpendicular to the view for lights, so that the rays of a light reach every point of the
// surface.
SamplesPlane plane_of(int v, View m, ShadingPoint p)
{
    SamplesPlane plane;

    plane.at = into_view(v, p.at, 1.0);
    plane.s = plane.q = vec3(0.0);
    if (v == 0) {
        plane.n = p.n;
        plane.dist = m.parallel ? p.n.z : dot(p.n, p.at);
        return plane;
    }
    plane.dist = m.parallel ? 1.0 : sqrt(dot(plane.at, plane.at));
    plane.n = m.parallel ? vec3(0.0, 0.0, 1.0) : plane.at / plane.dist;
    tangents(plane.n, plane.s, plane.q);
    return plane;
}

// As find_in_camera, in the view of a light.
SurfaceHit find_in_light(int v, ShadingPoint p, vec2 sampled)
{
    const View m = view_of(v);
    const SamplesPlane plane = plane_of(v, m, p);
    vec3 point = plane.at + sampled.x * plane.s + sampled.y * plane.q;
    vec2 off;
    vec4 texel_plane, texel_light;
    SurfaceHit hit;

    load_texel(v, m, point, off, texel_plane, texel_light);
    const float w = IS_PLANE_AT(texel_plane.x, texel_plane.y, texel_plane.z, off.x, off.y);
    const float z = m.parallel ? w : 1.0 / w, ratio = z / point.z;
    hit.valid = texel_plane.w == p.key && (m.parallel || w > 0.0);
    hit.light = texel_light.rgb;
    hit.jacobian = jacobian_of(m, texel_light.w, ratio, plane.dist);
    point = vec3(m.parallel ? point.xy : point.xy * ratio, z) - plane.at;
    hit.to = views[4 * (v - 1)].xyz * point.x + views[4 * (v - 1) + 1].xyz * point.y + views[4 * (v - 1) + 2].xyz * point.z;
    return hit;
}

// Density of a view's samples at point p of the surface (x_o + to), in units of 1/length^2; 0 if it is not visible.
float density_from(int v, ShadingPoint p, vec3 to)
{
    const View m = view_of(v);
    const SamplesPlane plane = plane_of(v, m, p);
    vec3 point = into_view(v, to, 0.0) + plane.at;
    vec2 off;
    vec4 texel_plane, texel_light;
    float ratio = 1.0, fraction;

    load_texel(v, m, point, off, texel_plane, texel_light);
    if (texel_plane.w != p.key)
        return 0.0;
    const float w = IS_PLANE_AT(texel_plane.x, texel_plane.y, texel_plane.z, off.x, off.y), z = m.parallel ? w : 1.0 / w;
    // Within a pixel's depth of the visible surface.
    const float deep = texel_light.w * (m.parallel ? 1.0 / m.f : z * z * (1.0 / m.f));
    if (!(abs(point.z - z) < deep + 1e-5 * abs(z)))
        return 0.0;
    // The point p' of the tangent plane on the same ray.
    const float towards = m.parallel ? plane.n.z : dot(plane.n, point);
    if (m.parallel) {
        point.z += dot(plane.n, plane.at - point) / towards;
    } else {
        ratio = towards / plane.dist; // z/z'
        if (!(ratio > 0.0))
            return 0.0;
        point /= ratio;
    }
    const float square = dot(point - plane.at, point - plane.at) * p.per_length2;
    if (!(square < IS_SQUARE_MAX))
        return 0.0;
    const float jacobian = pc.jacobian != 0 ? jacobian_of(m, texel_light.w, ratio, plane.dist) : 1.0;
    const int at = p.rows + find_row(square, fraction);
    float density = p.importance * (rows[at].w + fraction * rows[at + 1].w);
    if (p.broad2 > 0.0) {
        const float fall = 1.0 + square / p.broad2;
        density += p.others * p.uniform_density / (fall * fall);
    } else {
        density += p.others * (square <= p.reach2 ? p.uniform_density : 0.0);
    }
    density = pc.jacobian < 0 ? density * jacobian : density / jacobian;
    return density >= 0.0 && density < 1e30 ? density : 0.0;
}
