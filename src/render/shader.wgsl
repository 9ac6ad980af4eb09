// One shader for every pass. Colours are linear inside and leave encoded (sRGB curve) and
// premultiplied: encoding once per shaded pixel is far cheaper on a software rasteriser than
// an sRGB target, which decodes and encodes every sample at every blend and resolve.

struct Globals {
    view_proj: mat4x4f,
    light_proj: mat4x4f,
    eye: vec4f,       // camera position; w = 1: orthographic
    forward: vec4f,   // unit view direction
    ray_x: vec4f,     // pixel ray = forward + x * ray_x + y * ray_y (orthographic: origin offset)
    ray_y: vec4f,
    sun: vec4f,       // unit vector to the light; w = shadow strength
    sun_color: vec4f, // linear radiance; w = rim strength
    sky: vec4f,       // ambient from above
    ground: vec4f,    // ambient from below
    zenith: vec4f,    // backdrop, top
    horizon: vec4f,   // backdrop, horizon, and fog
    floor_a: vec4f,   // checker colours; a.w = cell size, b.w = 1: floor is drawn
    floor_b: vec4f,
    floor_pos: vec4f, // centre of interest x, y; floor height; fade start radius
    floor_fog: vec4f, // 1 / fade length; line strength
    shadow: vec4f,    // texel in uv; normal offset in metres; box is valid (1); texels of filter radius
    view: vec4f,      // width, height, 1/width, 1/height in pixels
};

@group(0) @binding(0) var<uniform> g: Globals;
@group(0) @binding(1) var shadow_map: texture_depth_2d;
@group(0) @binding(2) var shadow_sampler: sampler_comparison;

struct Vertex {
    @location(0) p: vec4f, // w: which cap of a capsule (-1, 0, +1)
    @location(1) n: vec4f,
};

struct Instance {
    @location(2) r0: vec4f, // rows of (rotation | translation)
    @location(3) r1: vec4f,
    @location(4) r2: vec4f,
    @location(5) size: vec4f, // w = half length of a capsule
    @location(6) color: vec4f, // linear rgb, opacity
};

struct Surface {
    @builtin(position) clip: vec4f,
    @location(0) world: vec3f,
    @location(1) normal: vec3f,
    @location(2) @interpolate(flat) color: vec4f,
};

fn world_of(v: Vertex, i: Instance) -> vec3f {
    let local = v.p.xyz * i.size.xyz + vec3f(0.0, 0.0, v.p.w * i.size.w);
    return vec3f(dot(i.r0.xyz, local), dot(i.r1.xyz, local), dot(i.r2.xyz, local))
        + vec3f(i.r0.w, i.r1.w, i.r2.w);
}

@vertex
fn vs_surface(v: Vertex, i: Instance) -> Surface {
    var out: Surface;
    out.world = world_of(v, i);
    let n = v.n.xyz / i.size.xyz;
    out.normal = vec3f(dot(i.r0.xyz, n), dot(i.r1.xyz, n), dot(i.r2.xyz, n));
    out.clip = g.view_proj * vec4f(out.world, 1.0);
    out.color = i.color;
    return out;
}

@vertex
fn vs_shadow(v: Vertex, i: Instance) -> @builtin(position) vec4f {
    return g.light_proj * vec4f(world_of(v, i), 1.0);
}

// The sRGB curve from three square roots: within 0.4 of one 8-bit step, without a power.
fn encode(c: vec3f) -> vec3f {
    let x = clamp(c, vec3f(0.0), vec3f(1.0));
    let s1 = sqrt(x);
    let s2 = sqrt(s1);
    let s3 = sqrt(s2);
    return clamp(0.662002687 * s1 + 0.684122060 * s2 - 0.323583601 * s3 - 0.0225411470 * x,
        vec3f(0.0), vec3f(1.0));
}

// Linear up to the knee, then a shoulder that never quite reaches white.
fn expose(c: vec3f) -> vec3f {
    let over = max(c - vec3f(0.6), vec3f(0.0));
    return min(c, vec3f(0.6)) + 0.4 * over / (over + vec3f(0.4));
}

// A place as the shadow map has it: uv and depth; w is 1 inside the map.
fn in_light(world: vec3f) -> vec4f {
    let p = g.light_proj * vec4f(world, 1.0);
    let uv = p.xy * vec2f(0.5, -0.5) + vec2f(0.5);
    return vec4f(uv, min(p.z, 0.9999), step(max(abs(p.x), abs(p.y)), 1.0));
}

fn look(uv: vec2f, depth: f32) -> f32 {
    return textureSampleCompareLevel(shadow_map, shadow_sampler, uv, depth);
}

// Each look is four loads from afar, the dearest thing here: one on objects, two across the
// diagonal on the floor, where the outline of a shadow is seen whole.
fn lit_object(world: vec3f) -> f32 {
    let p = in_light(world);
    return mix(1.0, look(p.xy, p.z), p.w * g.sun.w);
}

fn lit_floor(world: vec3f) -> f32 {
    let p = in_light(world);
    let a = vec2f(0.92, 0.38) * g.shadow.x * g.shadow.w;
    return mix(1.0, 0.5 * (look(p.xy + a, p.z) + look(p.xy - a, p.z)), p.w * g.sun.w);
}

fn view_dir(world: vec3f) -> vec3f {
    return select(normalize(g.eye.xyz - world), -g.forward.xyz, g.eye.w > 0.5);
}

fn shade(albedo: vec3f, n: vec3f, v: vec3f, lit: f32) -> vec3f {
    let ndl = dot(n, g.sun.xyz);
    let wrap = max(ndl, 0.0) * lit;
    let ambient = mix(g.ground.rgb, g.sky.rgb, 0.5 * n.z + 0.5);
    let h = normalize(g.sun.xyz + v);
    let s = max(dot(n, h), 0.0);
    let s4 = s * s * s * s;
    let s16 = s4 * s4 * s4 * s4;
    let spec = 0.10 * s16 * s4 * wrap;
    let f = 1.0 - max(dot(n, v), 0.0);
    let f2 = f * f;
    let rim = g.sun_color.w * f2 * f2 * (0.55 + 0.45 * n.z);
    return expose(albedo * (ambient + g.sun_color.rgb * wrap) + vec3f(spec) + rim * g.sky.rgb);
}

@fragment
fn fs_opaque(s: Surface) -> @location(0) vec4f {
    let n = normalize(s.normal);
    let lit = lit_object(s.world + n * g.shadow.y);
    return vec4f(encode(shade(s.color.rgb, n, view_dir(s.world), lit)), 1.0);
}

@fragment
fn fs_opaque_unshadowed(s: Surface) -> @location(0) vec4f {
    let n = normalize(s.normal);
    return vec4f(encode(shade(s.color.rgb, n, view_dir(s.world), 1.0)), 1.0);
}

// Translucent and glassy: thin where it faces the eye, dense on the outline, so that the shape
// reads although what is behind it stays visible.
@fragment
fn fs_ghost(s: Surface) -> @location(0) vec4f {
    let n = normalize(s.normal);
    let v = view_dir(s.world);
    let f = 1.0 - abs(dot(n, v));
    let alpha = clamp(s.color.a * (0.62 + 1.1 * f * f), 0.0, 0.96);
    let ambient = mix(g.ground.rgb, g.sky.rgb, 0.5 * n.z + 0.5);
    let light = ambient + g.sun_color.rgb * (0.35 + 0.45 * max(dot(n, g.sun.xyz), 0.0));
    let c = encode(expose(s.color.rgb * light * (1.0 - 0.35 * f)));
    return vec4f(c * alpha, alpha);
}

// Translucent geoms of the model itself: lit like solid ones.
@fragment
fn fs_glass(s: Surface) -> @location(0) vec4f {
    let n = normalize(s.normal);
    let c = encode(shade(s.color.rgb, n, view_dir(s.world), 1.0));
    return vec4f(c * s.color.a, s.color.a);
}

// A pass that only leaves depth still names its colour target.
@fragment
fn fs_depth_only() {}

// As far as the map goes: wipes a part of it.
@vertex
fn vs_far(@builtin(vertex_index) k: u32) -> @builtin(position) vec4f {
    return vec4f(vec2f(f32((k << 1u) & 2u), f32(k & 2u)) * 2.0 - vec2f(1.0), 1.0, 1.0);
}

// ---- lines: one quad a segment, mitred against its neighbours, width in pixels ----

struct Segment {
    @location(0) a: vec4f,    // w = half width in pixels at a
    @location(1) b: vec4f,    // w = half width in pixels at b
    @location(2) prev: vec4f, // neighbour before a (a itself: none)
    @location(3) next: vec4f, // neighbour after b
    @location(4) color_a: vec4f,
    @location(5) color_b: vec4f,
};

struct Line {
    @builtin(position) clip: vec4f,
    @location(0) color: vec4f,
};

fn screen(p: vec3f) -> vec4f {
    return g.view_proj * vec4f(p, 1.0);
}

fn unit(d: vec2f) -> vec2f {
    let l = length(d);
    return select(vec2f(0.0), d / max(l, 1e-6), l > 1e-4);
}

@vertex
fn vs_line(@builtin(vertex_index) k: u32, s: Segment) -> Line {
    let corner = array(0u, 1u, 2u, 2u, 1u, 3u)[k];
    let at_b = (corner & 1u) == 1u;
    let side = select(-1.0, 1.0, (corner & 2u) == 2u);
    let half_px = 0.5 * g.view.xy;
    let ca = screen(s.a.xyz);
    let cb = screen(s.b.xyz);
    let cn = screen(select(s.prev.xyz, s.next.xyz, at_b));
    let pa = ca.xy / ca.w * half_px;
    let pb = cb.xy / cb.w * half_px;
    let pn = cn.xy / cn.w * half_px;
    let along = unit(pb - pa);
    let before = select(unit(pa - pn), unit(pn - pb), at_b);
    let has = dot(before, before) > 0.5;
    let bisector = select(along, unit(along + before), has && dot(along, before) > -0.9);
    let normal = vec2f(-bisector.y, bisector.x);
    // A mitre grows with 1/cos of the half angle; past 2 it would be a spike.
    let stretch = min(1.0 / max(dot(bisector, along), 0.5), 2.0);
    let width = select(s.a.w, s.b.w, at_b);
    let base = select(ca, cb, at_b);
    let offset = normal * side * width * stretch / half_px;
    var out: Line;
    // A little towards the eye, so that a line on a surface is not eaten by it.
    out.clip = vec4f(base.xy + offset * base.w, base.z - 0.0008 * base.w, base.w);
    out.color = select(s.color_a, s.color_b, at_b);
    return out;
}

@fragment
fn fs_line(l: Line) -> @location(0) vec4f {
    return vec4f(encode(l.color.rgb) * l.color.a, l.color.a);
}

// ---- floor as depth only: needed when something reaches below it ----

@vertex
fn vs_floor(@builtin(vertex_index) k: u32) -> @builtin(position) vec4f {
    let c = array(vec2f(-1.0, -1.0), vec2f(1.0, -1.0), vec2f(-1.0, 1.0),
        vec2f(-1.0, 1.0), vec2f(1.0, -1.0), vec2f(1.0, 1.0))[k];
    let reach = g.floor_pos.w + 1.0 / g.floor_fog.x;
    return screen(vec3f(g.floor_pos.xy + c * reach, g.floor_pos.z));
}

// ---- backdrop: sky and floor once a camera, then the objects over it ----

struct Backdrop {
    @builtin(position) clip: vec4f,
    @location(0) ndc: vec2f,
};

@vertex
fn vs_backdrop(@builtin(vertex_index) k: u32) -> Backdrop {
    let c = vec2f(f32((k << 1u) & 2u), f32(k & 2u)) * 2.0 - vec2f(1.0);
    var out: Backdrop;
    out.clip = vec4f(c, 0.0, 1.0);
    out.ndc = c;
    return out;
}

struct Ray {
    origin: vec3f,
    dir: vec3f,
};

fn ray_of(ndc: vec2f) -> Ray {
    let across = ndc.x * g.ray_x.xyz + ndc.y * g.ray_y.xyz;
    if g.eye.w > 0.5 {
        return Ray(g.eye.xyz + across, g.forward.xyz);
    }
    return Ray(g.eye.xyz, g.forward.xyz + across);
}

fn sky_at(dir: vec3f) -> vec3f {
    let up = clamp(dir.z * inverseSqrt(dot(dir, dir)), 0.0, 1.0);
    return mix(g.horizon.rgb, g.zenith.rgb, sqrt(up));
}

// Share of the pixel's footprint on the dark cells: the integral of a square wave, so that the
// pattern turns grey instead of shimmering.
fn checker(p: vec2f, w: vec2f) -> f32 {
    let a = p - 0.5 * w;
    let b = p + 0.5 * w;
    let ia = floor(a * 0.5) + 2.0 * max(a * 0.5 - floor(a * 0.5) - 0.5, vec2f(0.0));
    let ib = floor(b * 0.5) + 2.0 * max(b * 0.5 - floor(b * 0.5) - 0.5, vec2f(0.0));
    let q = (ib - ia) / w;
    return q.x + q.y - 2.0 * q.x * q.y;
}

fn line_share(p: vec2f, w: vec2f, half_width: f32) -> vec2f {
    let d = abs(p - round(p));
    return clamp((vec2f(half_width) + 0.5 * w - d) / w, vec2f(0.0), vec2f(1.0))
        * clamp(vec2f(0.5) / w, vec2f(0.0), vec2f(1.0));
}

// Where a ray meets the floor; w: how far along it, positive in front of the eye.
fn floor_hit(ray: Ray) -> vec4f {
    let t = (g.floor_pos.z - ray.origin.z) / ray.dir.z;
    return vec4f(ray.origin + t * ray.dir, t);
}

// Sky and floor with and without sun. They stand still as long as the camera does: drawn once,
// and where a shadow falls, mixed.
struct Backdrops {
    @location(0) lit: vec4f,
    @location(1) dark: vec4f,
};

@fragment
fn fs_backdrop(b: Backdrop) -> Backdrops {
    let ray = ray_of(b.ndc);
    let sky = sky_at(ray.dir);
    let hit = floor_hit(ray);
    let t = hit.w;
    let cells = hit.xy / g.floor_a.w;
    // Derivatives by hand: fwidth would break at the horizon, where neighbours miss the floor.
    let px = abs(t / ray.dir.z) * 2.0 * g.view.zw;
    let wx = abs(g.ray_x.xy * ray.dir.z - g.ray_x.z * ray.dir.xy) * px.x;
    let wy = abs(g.ray_y.xy * ray.dir.z - g.ray_y.z * ray.dir.xy) * px.y;
    let ortho = (abs(g.ray_x.xy) * g.view.z + abs(g.ray_y.xy) * g.view.w) * 2.0;
    let w = max(select(wx + wy, ortho, g.eye.w > 0.5) / g.floor_a.w, vec2f(1e-5));
    var albedo = mix(g.floor_a.rgb, g.floor_b.rgb, checker(cells, w));
    let lines = line_share(cells, w, 0.008);
    albedo *= 1.0 - g.floor_fog.y * max(lines.x, lines.y);
    let ambient = g.sky.rgb;
    let lit = expose(albedo * (ambient + g.sun_color.rgb * g.sun.z));
    let dark = expose(albedo * ambient);
    let away = length(hit.xy - g.floor_pos.xy) - g.floor_pos.w;
    let fog = smoothstep(0.0, 1.0, clamp(away * g.floor_fog.x, 0.0, 1.0));
    let seen = select(0.0, 1.0 - fog, t > 0.0) * g.floor_b.w;
    return Backdrops(
        vec4f(encode(select(sky, mix(sky, lit, seen), seen > 0.0)), 1.0),
        vec4f(encode(select(sky, mix(sky, dark, seen), seen > 0.0)), 1.0));
}

@group(1) @binding(0) var objects: texture_2d<f32>;
@group(1) @binding(2) var backdrop_lit: texture_2d<f32>;
@group(1) @binding(3) var backdrop_dark: texture_2d<f32>;

// What lies behind the objects of a pixel.
fn behind(b: Backdrop) -> vec3f {
    let at = vec2i(b.clip.xy);
    let hit = floor_hit(ray_of(b.ndc));
    let lit = select(1.0, lit_floor(vec3f(hit.xy, g.floor_pos.z)), hit.w > 0.0);
    let dark = textureLoad(backdrop_dark, at, 0).rgb;
    let bright = textureLoad(backdrop_lit, at, 0).rgb;
    // Light adds up as squares of what is stored, nearly.
    return sqrt(mix(dark * dark, bright * bright, lit));
}

@fragment
fn fs_compose(b: Backdrop) -> @location(0) vec4f {
    let o = textureLoad(objects, vec2i(b.clip.xy), 0);
    return vec4f(o.rgb + (1.0 - o.a) * behind(b), 1.0);
}

@group(1) @binding(1) var samples: texture_multisampled_2d<f32>;

@fragment
fn fs_compose_samples(b: Backdrop) -> @location(0) vec4f {
    let at = vec2i(b.clip.xy);
    let o = 0.25 * (textureLoad(samples, at, 0) + textureLoad(samples, at, 1)
        + textureLoad(samples, at, 2) + textureLoad(samples, at, 3));
    return vec4f(o.rgb + (1.0 - o.a) * behind(b), 1.0);
}
