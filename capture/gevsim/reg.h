/* reg.h - the camera's 32-bit registers and the effects of writing them, except the control privilege. */
#ifndef CAP_GVCAM_REG_H
#define CAP_GVCAM_REG_H
#include "capture/gevsim/feature.h"
#include "capture/gevsim/gvcam.h"

struct gvcam_reg {
    uint32_t v[GVCAM_N_FEATURES]; /* floats as their bits */
    uint32_t user_set[GVCAM_N_FEATURES];
    uint8_t boot[0x100]; /* bootstrap registers 0x0000.. */
    char url[512];
    uint8_t *xml;
    size_t xml_bytes;
    uint32_t df; /* do not fragment */
    uint64_t latched;
    uint32_t ptp_status_latched;
    int64_t ptp_offset_latched;
    bool reset; /* DeviceReset was written; control.c does the reset */
};
void gvcam_reg_reset(struct cap_gvcam *c);  /* features as after power-up */
void gvcam_reg_reboot(struct cap_gvcam *c); /* everything, from the default user set */
/* Both: enum cap_gvcp_status. */
uint16_t gvcam_reg_read(struct cap_gvcam *c, uint32_t address, int64_t now, uint32_t *out);
uint16_t gvcam_reg_write(struct cap_gvcam *c, uint32_t address, int64_t now, uint32_t value);

/* xml.c: reg.xml and reg.url */
PVX_MUST_CHECK pvx_err gvcam_xml_make(struct cap_gvcam *c);
#endif
