"""The programs that run for every vertex and pixel (GLSL 3.30).

A processor that stands in for a GPU runs both sides of every `if`. So what not all surfaces
need is left out when a program is compiled: variants are named by what they have (`variant`).
Programs for what is cut out are apart for one more reason: a pixel that may be discarded
cannot be tested against depth beforehand.

Colours are linear in the scene's pass, stored as a quarter's square root; pictures are taken
as squares of linear colours too, which is near enough to sRGB and far cheaper.
"""

_LIGHT = """
uniform sampler2DShadow shadow_map;
uniform vec3 sun_direction; uniform vec3 sun_light; uniform vec3 sky_light;
uniform vec3 bounce_light; uniform vec3 lamp_light;

// Light on a surface; `light` is its share of the sky, of lamps, and its own glow.
vec3 arriving(vec3 normal, vec4 light, vec3 shadow_at) {
    vec3 sum = sky_light * light.x
             + bounce_light * (0.65 - 0.35 * normal.z) * (0.35 + 0.65 * light.x)
             + lamp_light * (light.y + light.z);
#ifdef SUN
    float slant = dot(normal, sun_direction);
#ifdef CUTOUT  // a leaf lets a third of the light through
    slant = 0.35 + 0.4 * abs(slant);
#endif
    sum += sun_light * (textureLod(shadow_map, shadow_at, 0.0) * max(slant, 0.0));
#endif
    return sum;
}
"""

SCENE_VERTEX = (
    """
#version 330
uniform mat4 clip_from_world;
uniform mat4 world_from_model;
uniform mat4 shadow_from_world;
uniform vec3 camera_m; uniform float haze_per_m;
in vec3 position_m; in vec3 normal; in vec2 uv; in vec3 tint;
in float sky; in float lamp; in float glow; in float gloss;
out vec3 facing; out vec2 at; out vec3 color; out vec4 light; out vec3 shadow_at;
out vec3 view; out float haze;
"""
    + _LIGHT
    + """
void main() {
    vec4 world = world_from_model * vec4(position_m, 1.0);
    facing = mat3(world_from_model) * normal;
    at = uv;
    light = vec4(sky, lamp, glow, gloss);
    shadow_at = (shadow_from_world * vec4(world.xyz + 0.04 * facing, 1.0)).xyz;
    view = world.xyz - camera_m;
    haze = haze_per_m * length(view);
#ifdef CUTOUT  // so many small surfaces, one behind another: they are lit at their corners
    color = tint * arriving(facing, light, shadow_at);
#else
    color = tint;
#endif
    gl_Position = clip_from_world * world;
}
"""
)

SCENE_FRAGMENT = (
    """
#version 330
uniform sampler2D picture;
uniform sampler2D sky_disc;
uniform vec3 horizon; uniform float wetness;
in vec3 facing; in vec2 at; in vec3 color; in vec4 light; in vec3 shadow_at;
in vec3 view; in float haze;
out vec4 stored;
"""
    + _LIGHT
    + """
vec3 mirrored(vec3 lit, vec3 normal, float mirror) {
    vec3 ray = normalize(view);
    vec3 seen = reflect(ray, normal);
    float grazing = 1.0 - clamp(-dot(ray, normal), 0.0, 1.0);
    float squared = grazing * grazing;
    float strength = mirror * (0.06 + 0.94 * squared * squared);
    vec3 disc = texture(sky_disc, 0.5 + 0.5 * seen.xy / (1.0 + max(seen.z, 0.0))).rgb;
    // Low down the houses opposite are mirrored rather than the sky.
    disc *= disc * 2.0 * mix(0.25, 1.0, smoothstep(0.25, 0.45, seen.z));
    return mix(lit, disc * (0.3 + 0.7 * light.x), strength);
}

void main() {
    vec4 texel = texture(picture, at);
#ifdef CUTOUT
    if (texel.a < 0.4) discard;
    vec3 lit = texel.rgb * texel.rgb * color;
#else
    vec3 normal = normalize(facing);
    vec3 lit = texel.rgb * texel.rgb * color * arriving(normal, light, shadow_at);
#endif
#ifdef GLOSS
    float wet = wetness * smoothstep(0.6, 0.95, normal.z);
    float mirror = max(light.w * (1.0 - 0.8 * dot(texel.rgb, vec3(0.333))), 0.6 * wet);
    lit = mirrored(lit * (1.0 - 0.45 * wet), normal, mirror);
#endif
    stored = vec4(sqrt(mix(lit, horizon, haze) * 0.25), 1.0);
}
"""
)

DEPTH_VERTEX = """
#version 330
uniform mat4 clip_from_world;
in vec3 position_m; in vec2 uv;
out vec2 at;
void main() {
    at = uv;
    gl_Position = clip_from_world * vec4(position_m, 1.0);
}
"""

DEPTH_FRAGMENT = """
#version 330
uniform sampler2D picture;
in vec2 at;
void main() {
#ifdef CUTOUT
    if (texture(picture, at).a < 0.4) discard;
#endif
}
"""

CAST_VERTEX = """
#version 330
uniform mat4 clip_from_world;
uniform mat4 world_from_model;
uniform mat4 shadow_from_world;
uniform vec3 sun_direction;
in vec3 position_m;
out vec3 shadow_at;
void main() {
    vec3 world = (world_from_model * vec4(position_m, 1.0)).xyz;
    vec3 ground = vec3(world.xy - sun_direction.xy * world.z / sun_direction.z, 0.012);
    shadow_at = (shadow_from_world * vec4(ground + vec3(0.0, 0.0, 0.04), 1.0)).xyz;
    gl_Position = clip_from_world * vec4(ground, 1.0);
}
"""

CAST_FRAGMENT = """
#version 330
uniform sampler2DShadow shadow_map;
uniform float remaining;
in vec3 shadow_at;
out vec4 stored;
void main() {
    stored = vec4(vec3(mix(1.0, remaining, texture(shadow_map, shadow_at))), 1.0);
}
"""

FULL_VERTEX = """
#version 330
in vec2 corner;
out vec2 at;
void main() {
    at = corner * 0.5 + 0.5;
    gl_Position = vec4(corner, 1.0, 1.0);
}
"""

SKY_FRAGMENT = """
#version 330
uniform sampler2D sky_disc;
uniform mat3 world_from_ray;
in vec2 at;
out vec4 stored;
void main() {
    vec3 ray = normalize(world_from_ray * vec3(at, 1.0));
    vec3 root = texture(sky_disc, 0.5 + 0.5 * ray.xy / (1.0 + max(ray.z, 0.0))).rgb;
    stored = vec4(root * sqrt(2.0) * 0.5, 1.0);
}
"""

CAMERA_FRAGMENT = """
#version 330
uniform sampler2D scene;
uniform vec2 size_px;
uniform vec2 focal; uniform vec2 centre;
uniform vec3 turned_rad;
uniform vec3 gain;
uniform float vignetting; uniform float noise; uniform uint seed;
in vec2 at;
out vec4 pixel;

uint scrambled(uint v) {
    v = v * 747796405u + 2891336453u;
    v = ((v >> ((v >> 28u) + 4u)) ^ v) * 277803737u;
    return (v >> 22u) ^ v;
}

// Four sums of two uniform numbers each, deviation 1.
vec3 random_values(uint key) {
    uint a = scrambled(key), b = scrambled(a), c = scrambled(b);
    vec3 one = vec3(uvec3(a, b, c) & 0xffffu), two = vec3(uvec3(a, b, c) >> 16u);
    return (one + two - 65535.0) / 65535.0 * 2.449;
}

// Between four pixels of a picture of twice the size, this is their mean.
vec3 stored_at(vec2 where) { return texture(scene, where).rgb; }

#ifdef BLUR
// What the camera turned past while the shutter was open.
vec3 seen() {
    vec2 p = (at * size_px - centre) / focal;
    vec3 w = turned_rad;
    vec2 flow = vec2(p.x * p.y * w.x - (1.0 + p.x * p.x) * w.y + p.y * w.z,
                     (1.0 + p.y * p.y) * w.x - p.x * p.y * w.y - p.x * w.z);
    vec2 moved = flow * focal / size_px;
    vec3 sum = vec3(0.0);
    for (int k = 0; k < 5; k++) sum += stored_at(at + moved * (float(k) - 2.0) / 5.0);
    return sum / 5.0;
}
#elif defined(OVERSAMPLED)
vec3 seen() { return stored_at(at); }
#else
float luminance_at(ivec2 pixel, ivec2 last) {
    return dot(texelFetch(scene, clamp(pixel, ivec2(0), last), 0).rgb, vec3(0.3, 0.6, 0.1));
}

// Smooths the steps of edges along their direction (after Lottes' fast approximate method).
vec3 seen() {
    vec2 px = 1.0 / size_px;
    ivec2 pixel = ivec2(gl_FragCoord.xy), last = ivec2(size_px) - 1;
    vec3 weights = vec3(0.3, 0.6, 0.1);
    vec3 middle = texelFetch(scene, pixel, 0).rgb;
    float nw = luminance_at(pixel + ivec2(-1, -1), last);
    float ne = luminance_at(pixel + ivec2(1, -1), last);
    float sw = luminance_at(pixel + ivec2(-1, 1), last);
    float se = luminance_at(pixel + ivec2(1, 1), last);
    float here = dot(middle, weights);
    float low = min(here, min(min(nw, ne), min(sw, se)));
    float high = max(here, max(max(nw, ne), max(sw, se)));
    vec2 along = vec2((sw + se) - (nw + ne), (nw + sw) - (ne + se));
    float damping = max((nw + ne + sw + se) * 0.03, 0.008);
    along = clamp(along / (min(abs(along.x), abs(along.y)) + damping), -4.0, 4.0) * px;
    vec3 near = 0.5 * (stored_at(at - along / 6.0) + stored_at(at + along / 6.0));
    vec3 far = 0.5 * near + 0.25 * (stored_at(at - along * 0.5) + stored_at(at + along * 0.5));
    float reached = dot(far, weights);
    return reached < low || reached > high ? near : far;
}
#endif

void main() {
    vec2 from_centre = (at - 0.5) * vec2(1.0, size_px.y / size_px.x) * 2.0;
    float falloff = 1.0 - vignetting * dot(from_centre, from_centre);
    vec3 quarter = seen();
    vec3 light = quarter * quarter * 4.0 * gain * falloff;
    uint x = uint(gl_FragCoord.x), y = uint(gl_FragCoord.y);
    vec3 random = random_values(seed + x * 1973u + y * 9277u * 4096u);
    // Grain of luminance is what phones leave in; that of colour is mostly smoothed away.
    random = 0.75 * vec3(random.x) + 0.35 * random;
    light = max(light + noise * sqrt(light + 0.02) * random, 0.0);
    // A phone's tone curve: shadows are lifted, highlights roll off.
    vec3 mapped = 1.0 - exp(-1.5 * light);
    mapped = mix(vec3(dot(mapped, vec3(0.3, 0.6, 0.1))), mapped, 0.88);
    vec3 root = sqrt(mapped);
    pixel = vec4(root * (0.8 + 0.2 * mapped) - 0.01, 1.0);
}
"""


def variant(program: str, *features: str) -> str:
    """A vertex or fragment program with some features: CUTOUT, SUN, GLOSS, BLUR, OVERSAMPLED."""
    defines = "".join(f"#define {feature}\n" for feature in features)
    return program.replace("#version 330\n", "#version 330\n" + defines, 1)


PROGRAMS = {
    "SCENE": (SCENE_VERTEX, SCENE_FRAGMENT),
    "DEPTH": (DEPTH_VERTEX, DEPTH_FRAGMENT),
    "CAST": (CAST_VERTEX, CAST_FRAGMENT),
    "SKY": (FULL_VERTEX, SKY_FRAGMENT),
    "CAMERA": (FULL_VERTEX, CAMERA_FRAGMENT),
}
"""Vertex and fragment program by name."""
