/* transfer.h - gamma-coded samples to linear light.
 *
 * With V = sample / full scale and L = light / light that gives full scale:
 *     sRGB    L = V / 12.92 for V <= 0.04045,  else ((V + 0.055) / 1.055)^2.4     IEC 61966-2-1
 *     BT.709  L = V / 4.5   for V < 0.081,     else ((V + 0.099) / 1.099)^(1/0.45)  ITU-R BT.709-6
 * Tables hold L as integers of 20 bits, so that sums over bins of up to 64x64 pixels are exact and
 * fit 32 bits.  Half a step is 4.8e-7, 1/640 of the least step of an 8-bit sRGB image.
 * Threads: any. */
#ifndef CAP_TRANSFER_H
#define CAP_TRANSFER_H
#include <stdint.h>

/* AUTO: sensor formats (grey, RGB, Bayer, float) are linear.  YUV and decoded JPEG pictures are sRGB or BT.709, as
 * the image declares (image.h).  V4L2 declares sRGB for such formats, or BT.709 for the colour spaces of television.
 * The UVC standard allows BT.709 or sRGB, and sRGB if the camera declares nothing. */
enum cap_transfer { CAP_TRANSFER_AUTO, CAP_TRANSFER_LINEAR, CAP_TRANSFER_SRGB, CAP_TRANSFER_BT709 };

#define CAP_LIGHT_ONE 0xFFFFFu /* L = 1 */

/* [2^bits] round(L CAP_LIGHT_ONE), bits 8 to 16; t SRGB or BT709.  Computed on first use (at 16 bits
 * 2 ms), static storage. */
const uint32_t *cap_transfer_table(enum cap_transfer t, int bits);
#endif
