/* xml.c - XML translated to YAML text with the same lines, by libxml2.  Nothing is fetched, no entity is expanded. */
#include <libxml/parser.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "recon/exchange/fields.h"

#define MAX_DEPTH 24

struct xml_out {
    FILE *f;
    long line;
    bool storage; /* OpenCV's FileStorage */
};

static void xml_quoted(struct xml_out *o, const char *s, size_t n)
{
    fputc('"', o->f);
    for (size_t i = 0; i < n; i++) {
        unsigned char c = (unsigned char)s[i];
        if (c == '"' || c == '\\')
            fputc('\\', o->f);
        if (c < ' ')
            fprintf(o->f, "\\x%02x", c);
        else
            fputc(c, o->f);
    }
    fputc('"', o->f);
}

static void xml_to_line(struct xml_out *o, const xmlNode *n)
{
    for (long line = xmlGetLineNo(n); o->line < line; o->line++)
        fputc('\n', o->f);
}

/* Text of an element: a word, or a list of words. */
static void xml_words(struct xml_out *o, const char *text)
{
    const char *blank = " \t\r\n", *p = text + strspn(text, blank);
    size_t n = strlen(p);
    while (n > 0 && strchr(blank, p[n - 1]) != NULL)
        n--;
    if (n >= 2 && p[0] == '"' && p[n - 1] == '"') { /* FileStorage's string */
        xml_quoted(o, p + 1, n - 2);
        return;
    }
    bool list = strcspn(p, blank) < n;
    fputs(list ? "[" : "", o->f);
    const char *end = p + n;
    for (bool first = true; p < end || first; first = false) {
        size_t word = strcspn(p, blank);
        fputs(first ? "" : ", ", o->f);
        xml_quoted(o, p, word < (size_t)(end - p) ? word : (size_t)(end - p));
        p += word;
        p += strspn(p, blank);
    }
    fputs(list ? "]" : "", o->f);
}

static void xml_text(struct xml_out *o, xmlNode *n)
{
    xmlChar *text = xmlNodeGetContent(n);
    xml_words(o, text != NULL ? (const char *)text : "");
    xmlFree(text);
}

static xmlNode *xml_element(xmlNode *n)
{
    while (n != NULL && n->type != XML_ELEMENT_NODE)
        n = n->next;
    return n;
}

static bool xml_named(const xmlNode *n, const char *name)
{
    return strcmp((const char *)n->name, name) == 0;
}

static bool xml_node(struct xml_out *o, xmlNode *n, int depth);

/* As FileStorage's own YAML: a mapping, or a sequence of elements called "_". */
static bool xml_storage(struct xml_out *o, xmlNode *n, int depth)
{
    xmlNode *child = xml_element(n->children);
    if (child == NULL) {
        xml_text(o, n);
        return true;
    }
    const bool list = xml_named(child, "_");
    bool ok = true;
    fputc(list ? '[' : '{', o->f);
    for (; child != NULL && ok; child = xml_element(child->next)) {
        xml_to_line(o, child);
        ok = xml_named(child, "_") == list;
        if (!list) {
            xml_quoted(o, (const char *)child->name, strlen((const char *)child->name));
            fputs(": ", o->f);
        }
        ok = ok && xml_node(o, child, depth + 1);
        fputs(", ", o->f);
    }
    fputc(list ? ']' : '}', o->f);
    return ok;
}

/* [name, {attributes}, text, children...] */
static bool xml_plain(struct xml_out *o, xmlNode *n, int depth)
{
    bool ok = true;
    fputc('[', o->f);
    xml_quoted(o, (const char *)n->name, strlen((const char *)n->name));
    fputs(", {", o->f);
    for (xmlAttr *a = n->properties; a != NULL; a = a->next) {
        xmlChar *v = xmlNodeListGetString(n->doc, a->children, 1);
        xml_quoted(o, (const char *)a->name, strlen((const char *)a->name));
        fputs(": ", o->f);
        xml_quoted(o, v != NULL ? (const char *)v : "", v != NULL ? strlen((const char *)v) : 0);
        fputs(", ", o->f);
        xmlFree(v);
    }
    fputs("}, ", o->f);
    xmlNode *child = xml_element(n->children);
    if (child == NULL)
        xml_text(o, n);
    else
        fputs("\"\"", o->f);
    for (; child != NULL && ok; child = xml_element(child->next)) {
        fputs(", ", o->f);
        ok = xml_node(o, child, depth + 1);
    }
    fputc(']', o->f);
    return ok;
}

static bool xml_node(struct xml_out *o, xmlNode *n, int depth)
{
    if (depth == MAX_DEPTH)
        return false;
    xml_to_line(o, n);
    return o->storage ? xml_storage(o, n, depth) : xml_plain(o, n, depth);
}

pvx_err exchange_from_xml(const char *text, size_t len, const char *name, char **out, size_t *n,
                          struct pvx_diag *d)
{
    *out = NULL;
    *n = 0;
    if (len > INT32_MAX)
        return pvx_fail(d, PVX_EFORMAT, "%s: too large", name);
    xmlParserCtxt *c = xmlNewParserCtxt();
    PVX_NEED(c);
    xmlDoc *doc = xmlCtxtReadMemory(c, text, (int)len, NULL, NULL,
                                    XML_PARSE_NONET | XML_PARSE_NOERROR | XML_PARSE_NOWARNING |
                                        XML_PARSE_NOCDATA);
    xmlNode *root = doc != NULL ? xmlDocGetRootElement(doc) : NULL;
    pvx_err e = PVX_OK;
    if (root == NULL) {
        const xmlError *why = xmlCtxtGetLastError(c);
        const char *m = why != NULL && why->message != NULL ? why->message : "unknown";
        e = pvx_fail(d, PVX_EFORMAT, "%s:%d: not valid XML: %.*s", name,
                     why != NULL ? why->line : 1, (int)strcspn(m, "\n"), m);
    } else {
        struct xml_out o = {open_memstream(out, n), 1, xml_named(root, "opencv_storage")};
        if (o.f == NULL)
            e = PVX_ENOMEM;
        else {
            bool ok = xml_node(&o, root, 0);
            if (fclose(o.f) != 0)
                e = PVX_ENOMEM;
            else if (!ok)
                e = pvx_fail(d, PVX_EFORMAT, "%s:%ld: elements are nested too deeply or mixed",
                             name, o.line);
        }
    }
    xmlFreeDoc(doc);
    xmlFreeParserCtxt(c);
    if (e != PVX_OK) {
        free(*out);
        *out = NULL;
    }
    return e;
}
