#include "daemon/cli/report/html.h"

#include <math.h>
#include <string.h>

#include "daemon/control/json.h"

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
