/* check_blacks.c - cameras that clip their blacks, where they were opened for it. */
#include <string.h>

#include "daemon/doctor/checks.h"
#include "recon/carve/clipped.h"

static void blacks_of(struct doctor *d, const struct doc_load_camera *c)
{
    char text[REC_PHOTO_CUT_TEXT];
    if (!c->pictured) {
        struct doc_finding *f = doc_say(d, DOC_UNKNOWN, 20, "camera.black",
                                        "%s gave no picture, so its blacks are not known", c->name);
        doc_note(f, "`pyrovox cameras test` says why; a running daemon has the cameras");
    } else if (rec_photo_say_cut(c->cut, c->pedestal, text)) {
        char *cure = strstr(text, "; ");
        *cure = '\0';
        struct doc_finding *f = doc_say(d, DOC_WARN, 35, "camera.black", "%s: %s", c->name, text);
        doc_means(f, "what is left of the noise looks like light that was not there");
        doc_note(f, "%s", cure + 2);
    } else {
        doc_say(d, DOC_OK, 35, "camera.black", "%s does not clip its blacks", c->name);
    }
}

void doc_check_blacks(struct doctor *d)
{
    for (size_t i = 0; i < d->load.n; i++)
        if (d->load.camera[i].looked)
            blacks_of(d, &d->load.camera[i]);
}
