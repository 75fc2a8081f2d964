/* SPDX-License-Identifier: MIT
 * mtl.h - the material libraries of OBJ files. */
#ifndef PELL_MTL_H
#define PELL_MTL_H

#include "scene/names.h"
#include "scene/scene.h"

struct pell_mtl {
    struct pell_import *import;
    struct pell_names names;     /* material names: id = index in the scene */
    struct pell_names libraries; /* libraries already read */
    bool *defined;               /* per material */
    size_t capacity;
};

/* The index of the material of that name, created if necessary. */
PELL_NODISCARD enum pell_result pell_mtl_material(struct pell_mtl *mtl, const char *name, size_t length, uint32_t *index);
/* Reads a library. A missing or broken one is a warning. */
PELL_NODISCARD enum pell_result pell_mtl_library(struct pell_mtl *mtl, const char *where, const char *reference);
/* The same from bytes, which end with a NUL; `folder` (empty, or ending in '/') is prepended to image names. */
PELL_NODISCARD enum pell_result pell_mtl_read(struct pell_mtl *mtl, const char *path, const char *folder, const uint8_t *data, size_t size);
void pell_mtl_finish(struct pell_mtl *mtl);

#endif
