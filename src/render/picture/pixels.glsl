// SPDX-License-Identifier: MIT
// pixels.glsl - which pixel of the picture an invocation of a batch has. A file that includes it declares the frame `fr` and the push
// constants `pc`.
struct Pixel {
    int x, y;
    int at;      // in the picture
    bool inside; // of what may be covered
};

// Blocks of 4 x 4 pixels lie together: the most coherent rays.
Pixel pixel_of(uint i)
{
    const int tile = int(pc.first + i / 64u), place = int(i % 64u), block = place / 16;
    Pixel p;

    p.x = fr.x0 + tile % fr.columns * PELL_PICTURE_TILE + (block & 1) * 4 + place % 4;
    p.y = fr.y0 + tile / fr.columns * PELL_PICTURE_TILE + (block >> 1) * 4 + place % 16 / 4;
    p.at = p.y * fr.pitch + p.x;
    p.inside = i < 64u * pc.count && p.x < fr.x1 && p.y < fr.y1;
    return p;
}
