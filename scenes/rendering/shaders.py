"""GLSL shaders of surfaces, water, sky, shadow depth and geometry. Shading is linear, images are square-root coded."""

import math

VERTEX = """#version 330 core
SWITCHES
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec2 uv;
#ifdef SOIL
layout(location = 3) in vec2 soil_uv;
layout(location = 4) in vec4 tint;
out vec2 on_soil;
#else
layout(location = 3) in vec4 tint;
#endif
uniform mat4 model, view_projection;
out vec3 at, facing;
out vec4 shade;
out vec2 st;
HAND_ON
#ifdef SHADOW_MAP
out vec3 in_shadow_map;
uniform mat4 shadow_from_world;
uniform float shadow_texel;
#endif
#ifdef FAR_SHADOW_MAP
out vec3 in_far_map;
uniform mat4 far_from_world;
uniform float far_texel;
#endif
#ifdef MIRRORED
uniform float water_level;
#endif
void main() {
    vec4 world = model * vec4(position, 1.0);
    at = world.xyz;
    facing = mat3(model) * normal;
    shade = tint;
    st = uv;
    HANDED_ON
#ifdef SOIL
    on_soil = soil_uv;
#endif
#ifdef SHADOW_MAP
    vec3 off = normalize(facing) * sign(dot(facing, to_lamp)) * 3.0 * shadow_texel;  // to the side that the lamp sees
    in_shadow_map = (shadow_from_world * vec4(at + off, 1.0)).xyz * 0.5 + 0.5;
#endif
#ifdef FAR_SHADOW_MAP
    in_far_map = (far_from_world * vec4(at + off * far_texel / shadow_texel, 1.0)).xyz * 0.5 + 0.5;
#endif
    gl_Position = view_projection * world;
#ifdef MIRRORED
    gl_ClipDistance[0] = world.z - water_level;
#endif
}
"""

TEXELS = """#ifdef OWN_LEVELS
vec4 codes_of(sampler2D map, vec2 st, float level) { return floor(255.0 * textureLod(map, st, level) + 0.5); }
vec4 texel_of(sampler2D map, vec2 st, float bias) {
    vec2 size = vec2(textureSize(map, 0)), across = dFdx(st) * size, down = dFdy(st) * size;
    float level = max(0.5 * log2(max(dot(across, across), dot(down, down))) + bias, 0.0), finer = floor(level);
    return floor(mix(codes_of(map, st, finer), codes_of(map, st, finer + 1.0), level - finer) + 0.5) / 255.0;
}
vec4 texel_of(sampler2D map, vec2 st) { return texel_of(map, st, 0.0); }
#else
#define texel_of texture
#endif
"""
"""Texels of mipmaps by section 8.14 of the OpenGL 4.5 specification, in whole codes, as llvmpipe has them, for other
drivers: the specification lets each choose sharper or softer mipmaps, mix them otherwise, and round otherwise."""

CLOUD_SHADOW = """#ifdef CLOUDS
uniform sampler2D clouds;
uniform vec3 cloud_u, cloud_v;
uniform vec2 cloud_shift;
float passes_clouds(vec3 p) { return texel_of(clouds, vec2(dot(p, cloud_u), dot(p, cloud_v)) + cloud_shift).r; }
#else
float passes_clouds(vec3 p) { return 1.0; }
#endif
"""

SURFACE = """#version 330 core
SWITCHES
TEXELS
in vec3 at, facing;
in vec4 shade;
in vec2 st;
layout(location = 0) out vec4 color;
SEEN
uniform sampler2D surface;
TAKE_OVER
#ifdef SHADOW_MAP
in vec3 in_shadow_map;
uniform sampler2DShadow shadow_map;
uniform float shadow_spread;
#endif

#ifdef FAR_SHADOW_MAP
in vec3 in_far_map;
uniform sampler2DShadow far_map;
uniform float far_spread;
#endif

CLOUD_SHADOW
#ifdef SHADOW_MAP
float passes(sampler2DShadow map, vec3 q, float spread) {
    if (any(lessThan(q.xy, vec2(0.0))) || any(greaterThan(q.xy, vec2(1.0)))) return 1.0;
    q.z = clamp(q.z, 0.0, 1.0);  // what lies deeper than all that casts a shadow is in their shadow, too
    vec2 s = vec2(spread, 0.4 * spread);
    return 0.5 * (texture(map, vec3(q.xy + s, q.z)) + texture(map, vec3(q.xy - s, q.z)));
}
float lit() {
    float share = passes(shadow_map, in_shadow_map, shadow_spread);
#ifdef FAR_SHADOW_MAP
    share *= passes(far_map, in_far_map, far_spread);
#endif
    return share * passes_clouds(at);
}
#else
float lit() { return 1.0; }
#endif

#ifdef FILM
uniform sampler2D film;
uniform float film_per_m;
#endif
#ifdef STANDING
uniform sampler2D mirror;
uniform vec2 size;
#endif
#ifdef SOIL
in vec2 on_soil;
uniform sampler2D soil;
#endif

void main() {
#if defined(SHARP) && !defined(CUTOUT)
    vec3 way = eye - at;
    float cosine = abs(dot(facing, way)) * inversesqrt(dot(way, way));
    vec4 texel = texel_of(surface, st, LEVEL_PER_COSINE * cosine - FINER);
#else
    vec4 texel = texel_of(surface, st);
#endif
#ifdef CUTOUT
    if (texel.a < 0.5) discard;
#endif
    vec3 albedo = texel.rgb * texel.rgb;
#ifdef FILM
    vec2 water = texel_of(film, at.xy * film_per_m).rg;
    vec3 wet = albedo * (WET_GAIN / (1.0 - WET_INNER * albedo));  // Lekner & Dorf 1988
    albedo = mix(albedo, wet, water.r);
#endif
#ifdef SOIL
    albedo *= texel_of(soil, on_soil).rgb;
#endif
    vec3 n = normalize(facing);
    vec3 to_eye = eye - at;
    float away = length(to_eye);
    to_eye /= away;
    if (!gl_FrontFacing) n = -n;
    float aside = 0.25 * dot(n.xy, to_lamp.xy) + 0.10 * dot(n.xy, vec2(-to_lamp.y, to_lamp.x));
    vec3 light = mix(below, above, 0.5 + 0.5 * n.z) * (1.0 + aside);  // the sky is brighter about the lamp
    vec3 seen = albedo * shade.rgb;
#ifdef LAMP
    float slope = dot(n, to_lamp);
    if (slope > 0.0) {
        vec3 sun = lamp * (slope * shade.a * lit());
        float width = roughness * roughness * roughness * roughness;
        float h = max(dot(n, normalize(to_lamp + to_eye)), 0.0);
        float d = h * h * (width - 1.0) + 1.0;
        seen = seen * (light + sun) + min(sun * 0.01 * width / (d * d * max(dot(n, to_eye), 0.1)), vec3(4.0));
    } else {
        seen *= light;
    }
#else
    seen *= light;
#endif
#ifdef STANDING
    float stands = abs(at.z) < 0.05 ? water.g : 0.0;
    if (stands > 0.0) {
        vec3 over = texture(mirror, gl_FragCoord.xy / size).rgb;
        float mirrored = 0.02 + 0.98 * pow(1.0 - clamp(to_eye.z, 0.0, 1.0), 5.0);  // Schlick 1994, of an index of 1.33
        seen = mix(seen, over * over, stands * mirrored);
    }
#endif
#ifdef HAZE
    seen = mix(haze_color, seen, exp(-haze * away));
#endif
    color = vec4(sqrt(seen), 1.0);
    SET_SEEN
}
"""

WATER = """#version 330 core
SWITCHES
TEXELS
in vec3 at, facing;
in vec4 shade;
in vec2 st;
layout(location = 0) out vec4 color;
SEEN
uniform sampler2D surface, mirror;
uniform mat4 view_projection;
TAKE_OVER
uniform vec2 size;
CLOUD_SHADOW
void main() {
    vec2 slope = (texel_of(surface, st).rg * 255.0 - 128.0) * RIPPLE_SLOPE;
    vec3 n = normalize(vec3(-slope, 1.0));
    vec3 to_eye = eye - at;
    float away = length(to_eye);
    to_eye /= away;
    vec3 way = reflect(-to_eye, n);
    vec4 far = view_projection * vec4(way.xy, -way.z, 0.0);  // mirror position of a point at infinity
    vec2 here = gl_FragCoord.xy / size, there = far.xy / far.w * 0.5 + 0.5;
    vec3 seen = texture(mirror, mix(here, there, NEARER)).rgb;
    float facing_us = clamp(dot(n, to_eye), 0.0, 1.0);
    float mirrored = 0.02 + 0.98 * pow(1.0 - facing_us, 5.0);  // Schlick 1994, of an index of 1.33
    float h = max(dot(n, normalize(to_lamp + to_eye)), 0.0);
    float width = roughness * roughness * roughness * roughness;
    float d = h * h * (width - 1.0) + 1.0;
    float passed = passes_clouds(at);
    vec3 glint = min(lamp * passed * shade.a * mirrored * 0.25 * width / (d * d), vec3(4.0));
    vec3 body = shade.rgb * (above + lamp * max(to_lamp.z, 0.0) * shade.a * passed);
    vec3 light = mix(body, seen * seen, mirrored) + glint;
#ifdef HAZE
    light = mix(haze_color, light, exp(-haze * away));
#endif
    color = vec4(sqrt(light), 1.0);
    SET_SEEN
}
"""

SKY_VERTEX = """#version 330 core
uniform mat4 world_from_clip;
out vec3 ray;
void main() {
    vec2 corner = vec2((gl_VertexID << 1) & 2, gl_VertexID & 2) * 2.0 - 1.0;
    vec4 far = world_from_clip * vec4(corner, 0.0, 1.0);
    ray = far.xyz / far.w;
    gl_Position = vec4(corner, 0.0, 1.0);
}
"""

SKY = """#version 330 core
in vec3 ray;
layout(location = 0) out vec4 color;
layout(location = 1) out vec2 depth_and_facet;
uniform sampler2D surface;
void main() {
    vec3 d = normalize(ray);
    vec2 at = vec2(atan(d.y, d.x) / 6.28318530718 + 0.5, 1.0 - acos(d.z) / 3.14159265359);
    color = vec4(texture(surface, at).rgb, 1.0);  // of one size, which no derivative is needed for
    depth_and_facet = vec2(0.0);
}
"""

DEPTH = """#version 330 core
SWITCHES
TEXELS
in vec2 st;
uniform sampler2D surface;
void main() {
#ifdef CUTOUT
    if (texel_of(surface, st).a < 0.5) discard;
#endif
}
"""

GEOMETRY = """#version 330 core
SWITCHES
TEXELS
in vec3 at;
in vec2 st;
SEEN
uniform sampler2D surface;
TAKE_OVER
void main() {
#ifdef CUTOUT
    if (texel_of(surface, st).a < 0.5) discard;
#endif
    SET_SEEN
}
"""

SEEN = "layout(location = 1) out vec2 depth_and_facet;"
SET_SEEN = "depth_and_facet = vec2(dot(depth_row, vec4(at, 1.0)), first_facet + float(gl_PrimitiveID));"
"""Second output of every program: depth in metres, and the row of `Facets` plus 1."""

HANDED = {
    "vec3": ("eye", "to_lamp", "lamp", "above", "below", "haze_color"),
    "float": ("roughness", "haze", "first_facet"),
    "vec4": ("depth_row",),
}
"""Uniforms that the vertex shader hands to the fragments: llvmpipe (Mesa 22.3) looks up each number of a uniform for
each fragment, eight loads for eight of them, and takes that of a flat input once."""
HANDED_NAMES = [(kind, name) for kind, names in HANDED.items() for name in names]
HAND_ON = " ".join(f"uniform {kind} {name}; flat out {kind} flat_{name};" for kind, name in HANDED_NAMES)
HANDED_ON = " ".join(f"flat_{name} = {name};" for _, name in HANDED_NAMES)
TAKE_OVER = "\n".join(f"flat in {kind} flat_{name};\n#define {name} flat_{name}" for kind, name in HANDED_NAMES)

RIPPLE_SLOPE = 0.004
"""Slope per unit of a ripple texture: 8 bits cover +-0.5."""
WATER_INDEX = 1.33


def diffuse_reflectance(index: float) -> float:
    """Reflectance of a smooth surface of a refractive index for isotropic light (Lekner & Dorf 1988)."""
    n2, n4 = index**2, index**4
    return (
        (3 * n2 + 2 * index + 1) / (3 * (index + 1) ** 2)
        - 2 * index * n2 * (n2 + 2 * index - 1) / ((n2 + 1) * (n4 - 1))
        + n2 * (n2 + 1) / (n2 - 1) ** 2 * math.log(index)
        - n2 * (n2 - 1) ** 2 / (n2 + 1) ** 3 * math.log(index * (index + 1) / (index - 1))
    )


WET_INNER = 1 - (1 - diffuse_reflectance(WATER_INDEX)) / WATER_INDEX**2
"""Share of the light from rough ground that its film of water reflects back down (Lekner & Dorf 1988)."""
WET_GAIN = (1 - ((WATER_INDEX - 1) / (WATER_INDEX + 1)) ** 2) * (1 - WET_INNER)
"""Light that enters the film at normal incidence times the share that leaves it: wet albedo is
WET_GAIN * dry / (1 - WET_INNER * dry)."""
NEARER = 0.6
"""Fraction of the reflection's shift by ripples that applies to infinity: most of what a river mirrors is near."""

FINER, LEVEL_PER_COSINE = 1.5, 1.25
"""Levels of detail by which the switch SHARP goes below OpenGL's, which follow the longer side of a pixel's footprint,
and how much of that the cosine between a surface's normal and the view takes back. Of values in steps of 1/4 they give
the least difference from supersampled images (docs/sites.md)."""


def with_switches(source: str, *switches: str) -> str:
    """The source with these preprocessor macros defined."""
    source = source.replace("TEXELS", TEXELS).replace("TAKE_OVER", TAKE_OVER)
    source = source.replace("HANDED_ON", HANDED_ON).replace("HAND_ON", HAND_ON)
    source = source.replace("CLOUD_SHADOW", CLOUD_SHADOW).replace("SET_SEEN", SET_SEEN).replace("SEEN", SEEN)
    source = source.replace("LEVEL_PER_COSINE", str(LEVEL_PER_COSINE)).replace("FINER", str(FINER))
    source = source.replace("WET_GAIN", f"{WET_GAIN:.6f}").replace("WET_INNER", f"{WET_INNER:.6f}")
    source = source.replace("RIPPLE_SLOPE", str(RIPPLE_SLOPE)).replace("NEARER", str(NEARER))
    return source.replace("SWITCHES", "\n".join(f"#define {name}" for name in switches))
