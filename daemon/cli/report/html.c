#include "daemon/cli/report/html.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "daemon/control/json.h"

#define PICTURE_MAX ((size_t)1 << 28)

void html_begin(FILE *f, const char *title, const char *more)
{
    fputs("<!DOCTYPE html>\n<html xmlns=\"http://www.w3.org/1999/xhtml\" lang=\"en\"><head>"
          "<meta charset=\"utf-8\"/><meta name=\"viewport\" "
          "content=\"width=device-width,initial-scale=1\"/><title>",
          f);
    html_text(f, title);
    fprintf(f,
            "</title><style>\n%sfigure{max-width:60rem;margin:.8rem 0}"
            "img{display:block;margin:auto}%s\n@page{size:A4;margin:1.6cm}</style></head>\n"
            "<body>\n",
            report_style, more);
}

void html_text(FILE *f, const char *s)
{
    while (*s != '\0') {
        size_t n = dmn_utf8(s);
        const char *out = *s == '&'    ? "&amp;"
                          : *s == '<'  ? "&lt;"
                          : *s == '>'  ? "&gt;"
                          : *s == '"'  ? "&quot;"
                          : *s == '\'' ? "&#39;"
                                       : NULL;
        bool control = (unsigned char)*s < 0x20 || *s == 0x7F;
        bool never = n == 3 && memcmp(s, "\xEF\xBF", 2) == 0 && (unsigned char)s[2] >= 0xBE;
        if (out == NULL && (n == 0 || control || never))
            out = "?";
        if (out != NULL)
            fputs(out, f);
        else
            fwrite(s, 1, n, f);
        s += n > 0 ? n : 1;
    }
}

void html_number(FILE *f, double v, int decimals)
{
    if (isfinite(v))
        fprintf(f, "%.*f", decimals, v);
    else
        fputs("\xE2\x80\x93", f);
}

void html_cell(FILE *f, double v, int decimals)
{
    fputs("<td class=\"n\">", f);
    html_number(f, v, decimals);
    fputs("</td>", f);
}

void html_base64(FILE *f, const uint8_t *v, size_t n)
{
    static const char digit[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    for (size_t i = 0; i < n; i += 3) {
        uint32_t a = v[i], b = i + 1 < n ? v[i + 1] : 0, c = i + 2 < n ? v[i + 2] : 0;
        uint32_t w = a << 16 | b << 8 | c;
        fputc(digit[w >> 18], f);
        fputc(digit[w >> 12 & 63], f);
        fputc(i + 1 < n ? digit[w >> 6 & 63] : '=', f);
        fputc(i + 2 < n ? digit[w & 63] : '=', f);
    }
}

pvx_err html_picture(FILE *f, const char *dir, const char *name, const char *caption,
                     struct pvx_diag *d)
{
    char path[4300], *bytes;
    size_t len;
    snprintf(path, sizeof path, "%s/%s", dir, name);
    PVX_TRY(pvx_file_read(path, PICTURE_MAX, &bytes, &len, d));
    fputs("<figure><img style=\"max-width:100%\" alt=\"\" src=\"data:image/png;base64,", f);
    html_base64(f, (const uint8_t *)bytes, len);
    free(bytes);
    fprintf(f, "\"/><figcaption>%s</figcaption></figure>\n", caption);
    return PVX_OK;
}
