/* SPDX-License-Identifier: MIT
 * blurs.c - the stage "spread" on the device: which Gaussians there are, by the rows of a sample. Mirror of spread/cpu.c. */
#include "render/picture/device_state.h"
#include "render/spread/stage.h"

#include <math.h>

static void run_over(struct pell_picture_device *d, enum picture_pass pass, const struct pell_spread_push *push)
{
    pell_gpu_run(d->commands, d->passes[pass], push, picture_tiles(push->x1 - push->x0), picture_tiles(push->y1 - push->y0), 1);
}

void picture_spread(struct pell_picture_device *d, const struct pell_picture_sample *s, struct pell_rect translucent)
{
    const struct pell_picture_row *rows = pell_gpu_buffer_host(d->buffers[ROWS_DOWN]);
    const struct pell_rect r = s->composite->rect;
    struct pell_spread_found found = { .finest = INFINITY };
    struct pell_spread_plan plan;

    for (int y = r.y0; y < r.y1; y++) {
        const struct pell_rect row = { (int) rows[y].straight0, y, (int) rows[y].straight1, y + 1 };
        if (rows[y].widest < 0.0f)
            continue;
        pell_rect_unite(&found.straight, &row);
        found.finest = fminf(found.finest, rows[y].finest);
        found.widest = fmaxf(found.widest, rows[y].widest);
    }
    if (!pell_spread_make_plan(&found, &translucent, &plan))
        return;
    pell_gpu_mark(d->commands, "spread");
    for (int level = plan.levels; level >= 0; level--) {
        struct pell_spread_push push = {
            .x0 = plan.around.x0,
            .y0 = plan.around.y0,
            .x1 = plan.around.x1,
            .y1 = plan.around.y1,
            .below = level > 0 ? plan.variance[level - 1] : -1.0f,
            .here = plan.variance[level],
            .above = level < PELL_SPREAD_LEVELS ? plan.variance[level + 1] : 0.0f,
            .level = level,
            .first = level == plan.levels,
        };
        run_over(d, SPREAD_SPLIT, &push);
        if (level == 0)
            break;
        push.inverse = plan.blur[level].inverse;
        push.taps = plan.blur[level].taps;
        push.spacing = plan.blur[level].spacing;
        run_over(d, SPREAD_ACROSS, &push);
        push.down = 1;
        run_over(d, SPREAD_DOWN, &push);
    }
}
