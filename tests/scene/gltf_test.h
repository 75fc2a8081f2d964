/* SPDX-License-Identifier: MIT
 * gltf_test.h - shared by the tests of the glTF reader: import of a file or bytes into a new scene, construction of a GLB, and a small
 * document that uses most of the supported features. */
#ifndef PELL_GLTF_TEST_H
#define PELL_GLTF_TEST_H

#include "base/file.h"
#include "pell_test.h"
#include "scene/import.h"

/* The file's content in its own units, as the importer produces it; *scene exists also after a failure. */
static inline enum pell_result import_bytes(struct pell_context *ctx, const char *path, const char *root, const void *data, size_t size,
                                            struct pell_scene **scene)
{
    struct pell_import import = { .ctx = ctx, .path = path, .root = root };
    enum pell_result res = pell_scene_create(ctx, scene);
    if (res != PELL_OK)
        return res;
    import.scene = *scene;
    return pell_import_gltf(&import, data, size);
}

static inline enum pell_result import_file(struct pell_context *ctx, const char *path, struct pell_scene **scene)
{
    uint8_t *data = NULL;
    size_t size = 0;
    char *root = pell_path_folder(ctx, path);
    enum pell_result res = root ? pell_file_read(ctx, path, &data, &size) : PELL_ERR_NOMEM;

    *scene = NULL;
    if (res == PELL_OK)
        res = import_bytes(ctx, path, root, data, size, scene);
    pell_free(ctx, data);
    pell_free(ctx, root);
    return res;
}

static inline void put32(uint8_t *p, uint32_t x)
{
    for (int i = 0; i < 4; i++)
        p[i] = (uint8_t) (x >> 8 * i);
}

/* A GLB of a JSON text and a binary chunk (none where bin_size is 0); free() it. */
static inline uint8_t *make_glb(const char *json, const void *bin, size_t bin_size, size_t *size)
{
    const size_t text = strlen(json), padded = (text + 3) / 4 * 4, bin_padded = (bin_size + 3) / 4 * 4;
    uint8_t *glb;

    *size = 20 + padded + (bin_size ? 8 + bin_padded : 0);
    glb = calloc(1, *size);
    if (!glb)
        abort();
    memcpy(glb, "glTF", 4);
    put32(glb + 4, 2);
    put32(glb + 8, (uint32_t) *size);
    put32(glb + 12, (uint32_t) padded);
    put32(glb + 16, 0x4e4f534a);
    memset(glb + 20, ' ', padded);
    memcpy(glb + 20, json, text);
    if (bin_size) {
        put32(glb + 20 + padded, (uint32_t) bin_padded);
        put32(glb + 24 + padded, 0x004e4942);
        memcpy(glb + 28 + padded, bin, bin_size);
    }
    return glb;
}

static inline enum pell_result import_glb(struct pell_context *ctx, const char *json, const void *bin, size_t bin_size,
                                          struct pell_scene **scene)
{
    size_t size;
    uint8_t *glb = make_glb(json, bin, bin_size, &size), *exact;
    enum pell_result res;

    /* exactly as many bytes as given plus the NUL of the contract, so that a sanitizer detects any read beyond */
    exact = malloc(size + 1);
    if (!exact)
        abort();
    memcpy(exact, glb, size);
    exact[size] = 0;
    res = import_bytes(ctx, "test.glb", ".", exact, size, scene);
    free(exact);
    free(glb);
    return res;
}

/* A 2 x 2 image: PNG, RGB: red, green / blue, white. */
#define TINY_PNG "iVBORw0KGgoAAAANSUhEUgAAAAIAAAACCAIAAAD91JpzAAAAEklEQVR42mP4z8DAAMIM/4EAAB/uBfvxq7p3AAAAAElFTkSuQmCC"

#define CORNERS 4

/* A square in the xy plane: positions, normals, uvs (0..1), u16 indices of two triangles, sparse data, bytes for other types. */
struct square {
    float position[CORNERS][3];
    float normal[CORNERS][3];
    float tangent[CORNERS][4];
    float uv[CORNERS][2];
    uint8_t color[CORNERS][4];
    uint16_t index[6];
    uint16_t sparse_index[2];
    float sparse_value[1][3];
    float instances[2][3];
};

static inline struct square make_square(void)
{
    return (struct square) {
        .position = { { 0, 0, 0 }, { 1, 0, 0 }, { 1, 1, 0 }, { 0, 1, 0 } },
        .normal = { { 0, 0, 1 }, { 0, 0, 1 }, { 0, 0, 1 }, { 0, 0, 1 } },
        .tangent = { { 1, 0, 0, 1 }, { 1, 0, 0, 1 }, { 1, 0, 0, 1 }, { 1, 0, 0, 1 } },
        .uv = { { 0, 1 }, { 1, 1 }, { 1, 0 }, { 0, 0 } },
        .color = { { 255, 0, 0, 255 }, { 0, 255, 0, 255 }, { 0, 0, 255, 255 }, { 51, 102, 153, 204 } },
        .index = { 0, 1, 2, 0, 2, 3 },
        .sparse_index = { 2, 0 },
        .sparse_value = { { 1, 1, 7 } },
        .instances = { { 10, 0, 0 }, { 20, 0, 0 } },
    };
}

/* The buffer and its views: view 0 to 8 are the members of struct square in their order. */
#define SQUARE_BUFFERS                                                                                                                     \
    "\"buffers\":[{\"byteLength\":260}],"                                                                                                  \
    "\"bufferViews\":[{\"buffer\":0,\"byteLength\":48},{\"buffer\":0,\"byteOffset\":48,\"byteLength\":48},"                                \
    "{\"buffer\":0,\"byteOffset\":96,\"byteLength\":64},{\"buffer\":0,\"byteOffset\":160,\"byteLength\":32},"                              \
    "{\"buffer\":0,\"byteOffset\":192,\"byteLength\":16},{\"buffer\":0,\"byteOffset\":208,\"byteLength\":12},"                             \
    "{\"buffer\":0,\"byteOffset\":220,\"byteLength\":4},{\"buffer\":0,\"byteOffset\":224,\"byteLength\":12},"                              \
    "{\"buffer\":0,\"byteOffset\":236,\"byteLength\":24}],"

#define SQUARE_ACCESSORS                                                                                                                   \
    "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":4,\"type\":\"VEC3\"},"                                              \
    "{\"bufferView\":1,\"componentType\":5126,\"count\":4,\"type\":\"VEC3\"},"                                                             \
    "{\"bufferView\":2,\"componentType\":5126,\"count\":4,\"type\":\"VEC4\"},"                                                             \
    "{\"bufferView\":3,\"componentType\":5126,\"count\":4,\"type\":\"VEC2\"},"                                                             \
    "{\"bufferView\":4,\"componentType\":5121,\"normalized\":true,\"count\":4,\"type\":\"VEC4\"},"                                         \
    "{\"bufferView\":5,\"componentType\":5123,\"count\":6,\"type\":\"SCALAR\"},"                                                           \
    "{\"bufferView\":0,\"componentType\":5126,\"count\":4,\"type\":\"VEC3\",\"sparse\":{\"count\":1,"                                      \
    "\"indices\":{\"bufferView\":6,\"componentType\":5123},\"values\":{\"bufferView\":7}}},"                                               \
    "{\"bufferView\":8,\"componentType\":5126,\"count\":2,\"type\":\"VEC3\"}],"

/* Most of the supported features, in about 5 kB. */
#define RICH_JSON                                                                                                                          \
    "{\"asset\":{\"version\":\"2.0\"},\"extensionsUsed\":[\"KHR_lights_punctual\",\"KHR_texture_transform\"],"                             \
    "\"scene\":0,\"scenes\":[{\"name\":\"main\",\"nodes\":[0,4]}],"                                                                        \
    "\"nodes\":[{\"name\":\"top\",\"translation\":[1,2,3],\"rotation\":[0,0.70710678,0,0.70710678],\"scale\":[-2,1,1],"                    \
    "\"children\":[1,2,3],\"mesh\":0},"                                                                                                    \
    "{\"matrix\":[1,0,0,0,0,1,0,0,0,0,1,0,5,6,7,1],\"mesh\":1,\"extensions\":{\"EXT_mesh_gpu_instancing\":"                                \
    "{\"attributes\":{\"TRANSLATION\":7}}}},"                                                                                              \
    "{\"camera\":0},{\"extensions\":{\"KHR_lights_punctual\":{\"light\":0}}},"                                                             \
    "{\"camera\":1,\"extensions\":{\"KHR_lights_punctual\":{\"light\":1}}}],"                                                              \
    "\"cameras\":[{\"type\":\"perspective\",\"name\":\"front\",\"perspective\":{\"yfov\":0.5,\"znear\":0.1}},"                             \
    "{\"type\":\"orthographic\",\"orthographic\":{\"xmag\":1,\"ymag\":2,\"znear\":0.1,\"zfar\":9}}],"                                      \
    "\"extensions\":{\"KHR_lights_punctual\":{\"lights\":[{\"type\":\"spot\",\"color\":[1,0.5,0.25],\"intensity\":8,"                      \
    "\"range\":4,\"spot\":{\"innerConeAngle\":0.2,\"outerConeAngle\":0.4}},{\"type\":\"directional\",\"intensity\":3}]}}," SQUARE_BUFFERS  \
        SQUARE_ACCESSORS "\"meshes\":[{\"name\":\"one\",\"primitives\":[{\"attributes\":{\"POSITION\":0,\"NORMAL\":1,\"TANGENT\":2,"       \
    "\"TEXCOORD_0\":3,\"TEXCOORD_1\":3,\"COLOR_0\":4},\"indices\":5,\"material\":0},"                                                      \
    "{\"attributes\":{\"POSITION\":6},\"mode\":5}]},"                                                                                      \
    "{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"mode\":6,\"material\":1},{\"attributes\":{\"POSITION\":0},\"mode\":1}]}],"        \
    "\"images\":[{\"uri\":\"data:image/png;base64," TINY_PNG "\"}],"                                                                       \
    "\"samplers\":[{\"wrapS\":33071,\"wrapT\":33648,\"magFilter\":9728},{}],"                                                              \
    "\"textures\":[{\"sampler\":0,\"source\":0},{\"sampler\":1,\"source\":0}],"                                                            \
    "\"materials\":[{\"name\":\"wax\",\"pbrMetallicRoughness\":{\"baseColorFactor\":[0.5,0.6,0.7,0.8],\"metallicFactor\":0.1,"             \
    "\"roughnessFactor\":0.2,\"baseColorTexture\":{\"index\":0,\"texCoord\":1,\"extensions\":{\"KHR_texture_transform\":"                  \
    "{\"offset\":[0.25,0.5],\"rotation\":0.3,\"scale\":[2,3],\"texCoord\":0}}},\"metallicRoughnessTexture\":{\"index\":1}},"               \
    "\"normalTexture\":{\"index\":0,\"scale\":0.5},\"emissiveFactor\":[1,0.5,0],\"emissiveTexture\":{\"index\":1},"                        \
    "\"alphaMode\":\"MASK\",\"alphaCutoff\":0.25,\"doubleSided\":true,\"extensions\":{\"KHR_materials_emissive_strength\":"                \
    "{\"emissiveStrength\":4},\"KHR_materials_ior\":{\"ior\":1.4},\"KHR_materials_specular\":{\"specularFactor\":0.7,"                     \
    "\"specularTexture\":{\"index\":1},\"specularColorFactor\":[1,0.9,0.8],\"specularColorTexture\":{\"index\":0}},"                       \
    "\"KHR_materials_diffuse_transmission\":{\"diffuseTransmissionFactor\":1},\"KHR_materials_volume\":"                                   \
    "{\"attenuationDistance\":0.001,\"attenuationColor\":[0.5,0.25,0.125]},\"KHR_materials_volume_scatter\":"                              \
    "{\"multiscatterColor\":[0.5,0.6,0.7],\"scatterAnisotropy\":0.2}}},"                                                                   \
    "{\"name\":\"paper\",\"extensions\":{\"KHR_materials_diffuse_transmission\":{\"diffuseTransmissionFactor\":0.6,"                       \
    "\"diffuseTransmissionColorFactor\":[0.9,0.8,0.7]}}}]}"

#endif
