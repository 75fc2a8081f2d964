/* SPDX-License-Identifier: MIT
 *
 * layers.h - the layers of a result: one row each, which allocation, clearing, averaging and the list of channels read.
 */
#ifndef PELL_LAYERS_H
#define PELL_LAYERS_H

#include "render/composite/stage.h"

enum pell_output_layer_when {
    PELL_LAYER_ALWAYS,
    PELL_LAYER_ASKED,  /* pell_settings.layers */
    PELL_LAYER_SINGLE, /* and the method returns single scattering separately */
    PELL_LAYER_NOISE,  /* and the method knows its standard error */
};

struct pell_output_layer {
    const char *names[3]; /* of channels, as EXR files have them */
    int components;       /* [1, 3] */
    size_t offset;        /* of the first plane's pointer in struct pell_accumulator */
    enum pell_output_layer_when when;
    int power; /* samples are added with their weight to this power; 0: not added */
    bool full_float;
};

enum { PELL_OUTPUT_LAYERS = 12, PELL_LAYER_CHANNELS = 3 * PELL_OUTPUT_LAYERS };
extern const struct pell_output_layer pell_output_layers[PELL_OUTPUT_LAYERS];

/* Whether a result has the layer. `single`: single scattering is separate; `noisy`: the method knows its standard error. */
static inline bool pell_output_layer_given(const struct pell_output_layer *l, const struct pell_settings *settings, bool single, bool noisy)
{
    switch (l->when) {
    case PELL_LAYER_ALWAYS: return true;
    case PELL_LAYER_ASKED: return settings->layers;
    case PELL_LAYER_SINGLE: return settings->layers && single;
    case PELL_LAYER_NOISE: return settings->layers && noisy;
    }
    return false;
}

static inline float **pell_output_layer_planes(const struct pell_accumulator *sum, const struct pell_output_layer *layer)
{
    return (float **) ((char *) sum + layer->offset);
}

/* Scales the sum of some samples to that of all: `up` = all / some. `size`: floats of a plane. */
void pell_output_layers_scale(const struct pell_accumulator *sum, size_t size, float up);

#endif
