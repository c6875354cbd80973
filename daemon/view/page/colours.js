// Colour maps for one channel: 256 colours each, from a few anchors.
const anchors = {
  grey: [[0, 0, 0], [255, 255, 255]],
  fire: [[0, 0, 0], [40, 6, 10], [110, 16, 10], [190, 50, 8], [238, 120, 20], [253, 195, 75], [255, 240, 180], [255, 255, 255]],
  viridis: [[68, 1, 84], [71, 45, 123], [59, 82, 139], [44, 114, 142], [33, 145, 140], [40, 174, 128], [94, 201, 98], [173, 220, 48], [253, 231, 37]],
  plasma: [[13, 8, 135], [75, 3, 161], [125, 3, 168], [168, 34, 150], [203, 70, 121], [229, 107, 93], [248, 148, 65], [253, 195, 40], [240, 249, 33]],
  ice: [[0, 0, 0], [8, 24, 58], [18, 62, 120], [34, 116, 170], [84, 172, 206], [160, 218, 230], [255, 255, 255]],
};
export const names = Object.keys(anchors);
// 0..1 to 0..255, as screens take it.
export const srgb = (x) => x <= 0 ? 0 : x >= 1 ? 255 : 255 * (x < 0.0031308 ? 12.92 * x : 1.055 * x ** (1 / 2.4) - 0.055);
export const srgb8 = (x) => Math.round(srgb(x));

export function table(name) {
  const a = anchors[name] || anchors.fire, out = new Uint8Array(256 * 4);
  for (let i = 0; i < 256; i++) {
    const x = i / 255 * (a.length - 1), k = Math.min(Math.floor(x), a.length - 2), f = x - k;
    for (let c = 0; c < 3; c++) out[4 * i + c] = Math.round(a[k][c] * (1 - f) + a[k + 1][c] * f);
    out[4 * i + 3] = 255;
  }
  return out;
}
