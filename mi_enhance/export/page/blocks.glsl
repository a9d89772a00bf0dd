// Whether there is material, and whether there is something else, in each block of 16 x 16 pixels; and the blocks that a
// program has to be drawn in: corners of the others lie outside of the picture. A depth test alone would not save its work.
#ifdef VERTEX
uniform sampler2D blocks;
uniform int row, is_material;  // blocks in a row of the tile
uniform float size;
void main() {
  ivec2 block = ivec2(gl_InstanceID % row, gl_InstanceID / row);
  vec2 there = texelFetch(blocks, block, 0).rg;
  vec2 corner = vec2(block) + vec2(gl_VertexID & 1, gl_VertexID >> 1);
  bool drawn = (is_material == 1 ? there.r : there.g) > 0.0;
  gl_Position = drawn ? vec4(corner * 32.0 / size - 1.0, 0, 1) : vec4(-2, -2, 0, 1);
}
#else
uniform sampler2D wheres;
uniform float size;
out vec4 colour;
void main() {
  ivec2 first = 16 * ivec2(gl_FragCoord.xy), end = min(first + 16, ivec2(size));
  vec2 there = vec2(0);
  for (int y = first.y; y < end.y; y++) for (int x = first.x; x < end.x; x++)
    there = max(there, texelFetch(wheres, ivec2(x, y), 0).w == 1.0 ? vec2(1, 0) : vec2(0, 1));
  colour = vec4(there, 0, 1);
}
#endif
