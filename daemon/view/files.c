#include "daemon/view/files.h"

#include <string.h>

#define HTML "text/html; charset=utf-8"
#define CSS  "text/css; charset=utf-8"
#define JS   "text/javascript; charset=utf-8"
#define SVG  "image/svg+xml"

#define PAGE(X)                  \
    X(index, "index.html", HTML) \
    X(style, "style.css", CSS)   \
    X(icon, "icon.svg", SVG)     \
    X(main, "main.js", JS)       \
    X(pvx, "pvx.js", JS)         \
    X(bricks, "bricks.js", JS)   \
    X(probe, "probe.js", JS)     \
    X(scale, "scale.js", JS)     \
    X(legend, "legend.js", JS)   \
    X(pointer, "pointer.js", JS) \
    X(worker, "worker.js", JS)   \
    X(flame, "flame.js", JS)     \
    X(shader, "shader.js", JS)   \
    X(orbit, "orbit.js", JS)     \
    X(link, "link.js", JS)       \
    X(overlay, "overlay.js", JS) \
    X(chart, "chart.js", JS)     \
    X(colours, "colours.js", JS) \
    X(cameras, "cameras.js", JS) \
    X(lost, "lost.js", JS)       \
    X(player, "player.js", JS)   \
    X(orders, "orders.js", JS)   \
    X(flat, "flat.js", JS)

#define BYTES(id, file, type)                                              \
    extern const unsigned char view_##id##_begin[], view_##id##_end[];     \
    __asm__(".section .rodata\n"                                           \
            ".global view_" #id "_begin, view_" #id "_end\n"               \
            "view_" #id "_begin:\n.incbin \"daemon/view/page/" file "\"\n" \
            "view_" #id "_end:\n.byte 0\n.previous\n");
PAGE(BYTES)

const struct view_file *view_files(size_t *n)
{
#define ROW(id, file, type) {file, type, view_##id##_begin, view_##id##_end},
    static const struct view_file files[] = {PAGE(ROW)};
    *n = sizeof files / sizeof files[0];
    return files;
}

const struct view_file *view_file_find(const char *path)
{
    size_t n;
    const struct view_file *f = view_files(&n);
    if (strcmp(path, "/") == 0)
        return f;
    for (size_t i = 0; i < n; i++)
        if (path[0] == '/' && strcmp(path + 1, f[i].name) == 0)
            return f + i;
    return NULL;
}
