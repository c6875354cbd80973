#include "capture/gev/genicam.h"

#include <glib.h>
#include <libxml/parser.h>
#include <stdio.h>
#include <string.h>

struct references {
    GHashTable *named;  /* nodes by name */
    GHashTable *levels; /* of references below a node */
    xmlNode *endless;
};

/* Whether a node's value comes from the node that this element names.  (pMax, pIsAvailable and others lead to a
 * value, and no value leads back to them.) */
static bool genicam_followed(const xmlNode *e)
{
    static const char *const names[] = {"pValue",        "pAddress",      "pLength",
                                        "pIndex",        "pVariable",     "pCommandValue",
                                        "pValueIndexed", "pValueDefault", NULL};
    return g_strv_contains(names, (const char *)e->name);
}

/* Whether the element is a part of a node and not a node itself. */
static bool genicam_property(const xmlNode *e)
{
    return e->name[0] == 'p' || strcmp((const char *)e->name, "Constant") == 0 ||
           strcmp((const char *)e->name, "Expression") == 0;
}

/* As in Aravis, the last node of a name counts. */
static void genicam_name_all(struct references *r, xmlNode *node)
{
    for (xmlNode *e = xmlFirstElementChild(node); e != NULL; e = xmlNextElementSibling(e)) {
        xmlChar *name = genicam_property(e) ? NULL : xmlGetProp(e, BAD_CAST "Name");
        if (name != NULL)
            g_hash_table_replace(r->named, name, e);
        genicam_name_all(r, e);
    }
}

/* The node with this name; NULL = none.  Frees the name. */
static xmlNode *genicam_named(const struct references *r, xmlChar *name)
{
    xmlNode *e = name != NULL ? g_hash_table_lookup(r->named, name) : NULL;
    xmlFree(name);
    return e;
}

static xmlChar *genicam_text(const xmlNode *e)
{
    xmlChar *text = NULL;
    for (const xmlNode *c = e->children; c != NULL; c = c->next)
        if (c->type == XML_TEXT_NODE || c->type == XML_CDATA_SECTION_NODE)
            text = xmlStrcat(text, c->content);
    return text;
}

static unsigned genicam_levels(struct references *r, xmlNode *node, unsigned depth);

/* The most levels below the children of `node`; children that are nodes themselves count only if `nested`. */
static unsigned genicam_children(struct references *r, xmlNode *node, unsigned depth, bool nested)
{
    unsigned most = 0;
    for (xmlNode *c = xmlFirstElementChild(node); c != NULL; c = xmlNextElementSibling(c)) {
        xmlNode *to[2] = {NULL, NULL};
        if (genicam_followed(c)) {
            to[0] = genicam_named(r, genicam_text(c));
            to[1] = genicam_named(r, xmlGetProp(c, BAD_CAST "pOffset")); /* of a pIndex */
        } else if (nested && !genicam_property(c)) {
            to[0] = c;
        }
        for (int i = 0; i < 2; i++)
            if (to[i] != NULL)
                most = MAX(most, 1 + genicam_levels(r, to[i], depth + 1));
    }
    return most;
}

static unsigned genicam_levels(struct references *r, xmlNode *node, unsigned depth)
{
    gpointer known;
    unsigned levels = ARAVIS_GENICAM_LEVELS; /* a node met again during its own count is endless */
    if (r->endless != NULL)
        return 0;
    if (g_hash_table_lookup_extended(r->levels, node, NULL, &known)) {
        levels = GPOINTER_TO_UINT(known);
    } else if (depth < ARAVIS_GENICAM_LEVELS) {
        g_hash_table_insert(r->levels, node, GUINT_TO_POINTER(levels));
        levels = genicam_children(r, node, depth, true);
        if (strcmp((const char *)node->name, "StructEntry") == 0) /* address and length are above */
            levels = MAX(levels, genicam_children(r, node->parent, depth, false));
        g_hash_table_insert(r->levels, node, GUINT_TO_POINTER(levels));
    }
    if (depth + levels >= ARAVIS_GENICAM_LEVELS && r->endless == NULL)
        r->endless = node;
    return levels;
}

bool aravis_genicam_ends(const char *xml, size_t len, char *node, size_t size)
{
    struct references r = {.named = g_hash_table_new_full(g_str_hash, g_str_equal, xmlFree, NULL),
                           .levels = g_hash_table_new(NULL, NULL)};
    xmlDoc *doc = xml != NULL && len <= INT_MAX
                      ? xmlReadMemory(xml, (int)len, NULL, NULL,
                                      XML_PARSE_NONET | XML_PARSE_NOERROR | XML_PARSE_NOWARNING)
                      : NULL;
    if (doc != NULL) {
        genicam_name_all(&r, (xmlNode *)doc);
        genicam_levels(&r, xmlDocGetRootElement(doc), 0);
    }
    if (r.endless != NULL) {
        xmlChar *name = xmlGetProp(r.endless, BAD_CAST "Name");
        snprintf(node, size, "%s", name != NULL ? (const char *)name : "");
        xmlFree(name);
    }
    xmlFreeDoc(doc);
    g_hash_table_destroy(r.named);
    g_hash_table_destroy(r.levels);
    return r.endless == NULL;
}
