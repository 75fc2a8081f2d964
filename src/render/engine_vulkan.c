/* SPDX-License-Identifier: MIT
 * engine_vulkan.c - the engine vulkan: methods run on a Vulkan device; all other stages of a frame are the cpu engine's. */
#include "render/engine.h"

static const struct pell_method_engine *vulkan_method(const struct pell_method *method)
{
    return method->vulkan;
}

void pell_engine_vulkan_make(struct pell_engine_interface *engine)
{
    *engine = pell_engine_cpu;
    engine->name = "vulkan";
    engine->method = vulkan_method;
}
