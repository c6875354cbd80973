/* xml.c - the GenICam description of the camera's registers, written from the feature table. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>

#include "base/mem.h"
#include "capture/gevsim/gevsim.h"

struct text {
    FILE *f;
    char *at;
    size_t n;
};

static const char *const categories[] = {
    "DeviceControl",    "ImageFormatControl",   "AcquisitionControl", "AnalogControl",
    "DigitalIOControl", "ActionControl",        "PtpControl",         "ChunkDataControl",
    "UserSetControl",   "TransportLayerControl"};
#define N_CATEGORIES (sizeof categories / sizeof categories[0])

static uint32_t xml_address_of(size_t k)
{
    return gvcam_features[k].address != 0 ? gvcam_features[k].address : GVF_ADDRESS(k);
}

static void open_register(FILE *f, const char *kind, const char *name, uint32_t address,
                          uint32_t bytes, unsigned access, const char *port)
{
    fprintf(f,
            "<%s Name=\"%sReg\"><Address>0x%x</Address><Length>%u</Length><AccessMode>%s"
            "</AccessMode><pPort>%s</pPort><Cachable>NoCache</Cachable>",
            kind, name, address, bytes,
            access == GVA_R   ? "RO"
            : access == GVA_W ? "WO"
                              : "RW",
            port);
}

static void put_int_register(FILE *f, const struct gvcam_feature_def *d, uint32_t address)
{
    bool one = d->kind == GVK_BIT || d->kind == GVK_BIT_BOOL;
    if (one || d->bit > 0) { /* this bit, or the bits from it to the least significant */
        open_register(f, "MaskedIntReg", d->name, address, 4, d->access & 3, "Device");
        fprintf(f, one ? "<Bit>%d</Bit>" : "<LSB>31</LSB><MSB>%d</MSB>", d->bit);
        fprintf(f, "<Sign>Unsigned</Sign><Endianess>BigEndian</Endianess></MaskedIntReg>\n");
    } else {
        open_register(f, "IntReg", d->name, address, d->kind == GVK_INT64 ? 8 : 4, d->access & 3,
                      "Device");
        fprintf(f, "<Sign>%s</Sign><Endianess>BigEndian</Endianess></IntReg>\n",
                d->kind == GVK_INT64 ? "Signed" : "Unsigned");
    }
}

static void put_limits(FILE *f, const struct gvcam_feature_def *d, double min, double inc)
{
    fprintf(f, "<Min>%.10g</Min>", min);
    if (d->max_of != NULL)
        fprintf(f, "<pMax>%s</pMax>", d->max_of);
    else
        fprintf(f, "<Max>%.10g</Max>", d->max);
    if (d->kind == GVK_INT)
        fprintf(f, "<Inc>%.10g</Inc>", inc > 0 ? inc : 1);
}

static void put_entries(FILE *f, const struct gvcam_entry *e)
{
    for (; e->name != NULL; e++)
        fprintf(f, "<EnumEntry Name=\"%s\"><Value>%u</Value></EnumEntry>", e->name, e->value);
}

static void put_formats(FILE *f, const struct cap_gvcam *c)
{
    enum cap_pixfmt fmt[CAP_N_FMT];
    size_t n = gvcam_formats(c, fmt, CAP_N_FMT);
    for (size_t k = 0; k < n; k++)
        fprintf(f, "<EnumEntry Name=\"%s\"><Value>%u</Value></EnumEntry>", cap_pixfmt_name(fmt[k]),
                cap_pixfmt_pfnc(fmt[k]));
}

static void put_head(FILE *f, const char *node, const struct gvcam_feature_def *d)
{
    fprintf(f, "<%s Name=\"%s\" NameSpace=\"Standard\">", node, d->name);
    if (d->tip != NULL)
        fprintf(f, "<ToolTip>%s</ToolTip>", d->tip);
}

static void put_selected(FILE *f, const char *name)
{
    for (const struct gvcam_feature_def *d = gvcam_features; d->category != NULL; d++)
        if (d->selector != NULL && d->name != NULL && name != NULL &&
            strcmp(d->selector, name) == 0)
            fprintf(f, "<pSelected>%s</pSelected>", d->name);
}

static void put_feature(FILE *f, const struct cap_gvcam *c, size_t k)
{
    const struct gvcam_feature_def *d = &gvcam_features[k];
    uint32_t address = xml_address_of(k);
    double inc = k == GVF_WIDTH && c->c.width % 4 == 0 ? 4 : d->inc;
    double min = k == GVF_WIDTH && inc == 4 ? 4 : d->min;
    switch (d->kind) {
    case GVK_STRING:
        fprintf(f,
                "<StringReg Name=\"%s\" NameSpace=\"Standard\"><Address>0x%x</Address><Length>%u"
                "</Length><AccessMode>%s</AccessMode><pPort>Device</pPort></StringReg>\n",
                d->name, address, d->bytes, d->access == GVA_R ? "RO" : "RW");
        return;
    case GVK_FLOAT:
        put_head(f, "Float", d);
        fprintf(f, "<pValue>%sReg</pValue>", d->name);
        put_limits(f, d, min, 0);
        if (d->unit != NULL)
            fprintf(f, "<Unit>%s</Unit>", d->unit);
        fprintf(f, "</Float>\n");
        open_register(f, "FloatReg", d->name, address, 4, d->access & 3, "Device");
        fprintf(f, "<Endianess>BigEndian</Endianess></FloatReg>\n");
        return;
    case GVK_ENUM:
    case GVK_FORMAT:
        put_head(f, "Enumeration", d);
        if (d->kind == GVK_ENUM)
            put_entries(f, d->entry);
        else
            put_formats(f, c);
        fprintf(f, "<pValue>%sReg</pValue>", d->name);
        put_selected(f, d->name);
        fprintf(f, "</Enumeration>\n");
        break;
    case GVK_BOOL:
    case GVK_BIT_BOOL:
        put_head(f, "Boolean", d);
        fprintf(f, "<pValue>%sReg</pValue></Boolean>\n", d->name);
        break;
    case GVK_COMMAND:
    case GVK_BIT:
        put_head(f, "Command", d);
        fprintf(f, "<pValue>%sReg</pValue><CommandValue>1</CommandValue></Command>\n", d->name);
        break;
    case GVK_INT:
    case GVK_INT64:
        put_head(f, "Integer", d);
        fprintf(f, "<pValue>%sReg</pValue>", d->name);
        if (d->kind == GVK_INT)
            put_limits(f, d, min, inc);
        if (d->unit != NULL)
            fprintf(f, "<Unit>%s</Unit>", d->unit);
        put_selected(f, d->name);
        fprintf(f, "</Integer>\n");
        break;
    }
    put_int_register(f, d, address);
}

static void put_chunk(FILE *f, const struct gvcam_chunk_def *d)
{
    const char *node = d->kind == GVK_FLOAT ? "Float" : "Integer";
    fprintf(f, "<Port Name=\"%sPort\"><ChunkID>%x</ChunkID></Port>\n", d->feature, d->id);
    fprintf(f, "<%s Name=\"%s\" NameSpace=\"Standard\"><pValue>%sReg</pValue></%s>\n", node,
            d->feature, d->feature, node);
    char port[64];
    snprintf(port, sizeof port, "%sPort", d->feature);
    open_register(f, d->kind == GVK_FLOAT ? "FloatReg" : "IntReg", d->feature, 0, d->bytes, GVA_R,
                  port);
    fprintf(f, "%s<Endianess>BigEndian</Endianess></%s>\n",
            d->kind == GVK_FLOAT ? "" : "<Sign>Unsigned</Sign>",
            d->kind == GVK_FLOAT ? "FloatReg" : "IntReg");
}

static void put_categories(FILE *f)
{
    fprintf(f, "<Category Name=\"Root\" NameSpace=\"Standard\">");
    for (size_t k = 0; k < N_CATEGORIES; k++)
        fprintf(f, "<pFeature>%s</pFeature>", categories[k]);
    fprintf(f, "</Category>\n");
    for (size_t k = 0; k < N_CATEGORIES; k++) {
        fprintf(f, "<Category Name=\"%s\" NameSpace=\"Standard\">", categories[k]);
        for (const struct gvcam_feature_def *d = gvcam_features; d->category != NULL; d++)
            if (d->name != NULL && strcmp(d->category, categories[k]) == 0)
                fprintf(f, "<pFeature>%s</pFeature>", d->name);
        for (size_t j = 0; strcmp(categories[k], "ChunkDataControl") == 0 && j < GVCAM_N_CHUNKS;
             j++)
            if (gvcam_chunk_defs[j].feature != NULL)
                fprintf(f, "<pFeature>%s</pFeature>", gvcam_chunk_defs[j].feature);
        fprintf(f, "</Category>\n");
    }
}

static pvx_err xml_write_text(const struct cap_gvcam *c, char **out, size_t *n)
{
    FILE *f = open_memstream(out, n);
    PVX_NEED(f);
    fprintf(f, "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n"
               "<RegisterDescription ModelName=\"SimCam\" VendorName=\"Pyrovox\" "
               "ToolTip=\"Simulated GigE Vision camera\" StandardNameSpace=\"GEV\" "
               "SchemaMajorVersion=\"1\" SchemaMinorVersion=\"1\" SchemaSubMinorVersion=\"0\" "
               "MajorVersion=\"1\" MinorVersion=\"0\" SubMinorVersion=\"0\" "
               "ProductGuid=\"3B5C1F0A-6D1E-4E0B-9A57-50595256584F\" "
               "VersionGuid=\"7C0D9E42-2A31-4C55-8F10-50595256584F\" "
               "xmlns=\"http://www.genicam.org/GenApi/Version_1_1\" "
               "xmlns:xsi=\"http://www.w3.org/2001/XMLSchema-instance\" "
               "xsi:schemaLocation=\"http://www.genicam.org/GenApi/Version_1_1 "
               "http://www.genicam.org/GenApi/GenApiSchema_Version_1_1.xsd\">\n");
    put_categories(f);
    for (size_t k = 0; gvcam_features[k].category != NULL; k++)
        if (gvcam_features[k].name != NULL)
            put_feature(f, c, k);
    for (size_t k = 0; k < GVCAM_N_CHUNKS; k++)
        if (gvcam_chunk_defs[k].feature != NULL)
            put_chunk(f, &gvcam_chunk_defs[k]);
    fprintf(f, "<Port Name=\"Device\" NameSpace=\"Standard\"/>\n</RegisterDescription>\n");
    bool bad = ferror(f) != 0;
    if (fclose(f) != 0 || bad) {
        PVX_FREE(*out);
        return PVX_ENOMEM;
    }
    return PVX_OK;
}

/* ---- a zip archive of one file (PKWARE APPNOTE 4.3) -------------------------------------------- */

static void le16(uint8_t *p, unsigned v)
{
    p[0] = (uint8_t)v;
    p[1] = (uint8_t)(v >> 8);
}
static void le32(uint8_t *p, unsigned long v)
{
    le16(p, (unsigned)v & 0xffff);
    le16(p + 2, (unsigned)(v >> 16) & 0xffff);
}

/* The 26 bytes that a local and a central header have in common, from "version needed" on. */
static void zip_common(uint8_t *p, unsigned long crc, size_t packed, size_t plain, size_t name)
{
    memset(p, 0, 26);
    le16(p, 20);
    le16(p + 4, 8);    /* deflate */
    le16(p + 8, 0x21); /* 1980-01-01 */
    le32(p + 10, crc);
    le32(p + 14, packed);
    le32(p + 18, plain);
    le16(p + 22, (unsigned)name);
}

static pvx_err zip(const char *name, const uint8_t *in, size_t n, uint8_t **out, size_t *out_n)
{
    z_stream z = {0};
    size_t len = strlen(name);
    if (deflateInit2(&z, 9, Z_DEFLATED, -15, 9, Z_DEFAULT_STRATEGY) != Z_OK)
        return PVX_ENOMEM;
    size_t room = deflateBound(&z, n);
    uint8_t *p = pvx_calloc(1, 30 + len + room + 46 + len + 22);
    if (p != NULL) {
        z.next_in = (uint8_t *)(uintptr_t)in;
        z.avail_in = (unsigned)n;
        z.next_out = p + 30 + len;
        z.avail_out = (unsigned)room;
        (void)deflate(&z, Z_FINISH); /* there is enough room, so it always finishes */
    }
    size_t packed = z.total_out;
    deflateEnd(&z);
    PVX_NEED(p);
    unsigned long crc = crc32(0, in, (unsigned)n);
    le32(p, 0x04034b50);
    zip_common(p + 4, crc, packed, n, len);
    memcpy(p + 30, name, len);
    uint8_t *dir = p + 30 + len + packed;
    le32(dir, 0x02014b50);
    le16(dir + 4, 20);
    zip_common(dir + 6, crc, packed, n, len);
    memcpy(dir + 46, name, len);
    uint8_t *end = dir + 46 + len;
    le32(end, 0x06054b50);
    le16(end + 8, 1);
    le16(end + 10, 1);
    le32(end + 12, 46 + len);
    le32(end + 16, (size_t)(dir - p));
    *out = p;
    *out_n = (size_t)(end + 22 - p);
    return PVX_OK;
}

pvx_err gvcam_xml_make(struct cap_gvcam *c)
{
    char *text = NULL;
    size_t n = 0;
    PVX_TRY(xml_write_text(c, &text, &n));
    c->reg.xml = (uint8_t *)text;
    c->reg.xml_bytes = n;
    if (c->c.zip) {
        pvx_err e =
            zip("pyrovox_simcam.xml", (const uint8_t *)text, n, &c->reg.xml, &c->reg.xml_bytes);
        if (e != PVX_OK)
            return e;
        free(text);
    }
    snprintf(c->reg.url, sizeof c->reg.url, "Local:pyrovox_simcam.%s;%x;%zx",
             c->c.zip ? "zip" : "xml", GVB_XML, c->reg.xml_bytes);
    return PVX_OK;
}
