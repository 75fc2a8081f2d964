// SPDX-License-Identifier: MIT
// pixels.glsl - mapping of a batch's invocations to pixels of the image. A file that includes it declares the frame `fr` and the push
// constants `pc`.
struct Pixel {
    int x, y;
    int at;      // index in the image's planes
    bool inside; // the pixel is in the rectangle that may be covered
};

// Consecutive invocations are blocks of 4 x 4 pixels, which have the most coherent rays.
Pixel pixel_of(uint i)
{
    const int tile = int(pc.first + i / 64u), index_in_tile = int(i % 64u), block = index_in_tile / 16;
    Pixel p;

    p.x = fr.x0 + tile % fr.columns * PELL_PICTURE_TILE + (block & 1) * 4 + index_in_tile % 4;
    p.y = fr.y0 + tile / fr.columns * PELL_PICTURE_TILE + (block >> 1) * 4 + index_in_tile % 16 / 4;
    p.at = p.y * fr.pitch + p.x;
    p.inside = i < 64u * pc.count && p.x < fr.x1 && p.y < fr.y1;
    return p;
}
