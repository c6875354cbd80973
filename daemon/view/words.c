#include "daemon/view/words.h"

#include <cjson/cJSON.h>
#include <string.h>

/* A whole number that a double holds exactly. */
static bool words_whole(const cJSON *j, uint64_t *out)
{
    if (!cJSON_IsNumber(j) || !(j->valuedouble >= 0) || j->valuedouble > 9007199254740992.0)
        return false;
    *out = (uint64_t)j->valuedouble;
    return (double)*out == j->valuedouble;
}

static bool flag(const cJSON *j, bool *out)
{
    *out = cJSON_IsTrue(j) != 0;
    return cJSON_IsBool(j) != 0;
}

static bool token(const cJSON *j, char *out)
{
    if (!cJSON_IsString(j) || strlen(j->valuestring) > VIEW_TOKEN_DIGITS)
        return false;
    memcpy(out, j->valuestring, strlen(j->valuestring) + 1);
    return true;
}

static bool words_speed(const cJSON *j, double *out)
{
    if (!cJSON_IsNumber(j) || !(j->valuedouble >= 0.01 && j->valuedouble <= 100))
        return false;
    *out = j->valuedouble;
    return true;
}

static bool words_order(const cJSON *j, enum view_order *out)
{
    *out = cJSON_IsString(j) ? view_order_of(j->valuestring) : VIEW_N_ORDERS;
    return *out != VIEW_N_ORDERS;
}

static bool words_take(const cJSON *j, struct view_words *w)
{
    static const struct {
        const char *name;
        enum view_said said;
    } keys[] = {
        {"token", VIEW_SAID_TOKEN},   {"credits", VIEW_SAID_CREDITS},   {"drawn", VIEW_SAID_DRAWN},
        {"hidden", VIEW_SAID_HIDDEN}, {"previews", VIEW_SAID_PREVIEWS}, {"play", VIEW_SAID_PLAY},
        {"seek", VIEW_SAID_SEEK},     {"speed", VIEW_SAID_SPEED},       {"held", VIEW_SAID_HELD},
        {"order", VIEW_SAID_ORDER},   {"bars", VIEW_SAID_BARS},         {"soot", VIEW_SAID_SOOT}};
    unsigned said = 0;
    for (size_t i = 0; i < sizeof keys / sizeof keys[0]; i++)
        if (j->string != NULL && strcmp(j->string, keys[i].name) == 0)
            said = keys[i].said;
    w->said |= said;
    switch (said) {
    case VIEW_SAID_TOKEN: return token(j, w->token);
    case VIEW_SAID_CREDITS: return words_whole(j, &w->credits);
    case VIEW_SAID_HELD: return words_whole(j, &w->held);
    case VIEW_SAID_DRAWN: return words_whole(j, &w->drawn);
    case VIEW_SAID_HIDDEN: return flag(j, &w->hidden);
    case VIEW_SAID_PREVIEWS: return flag(j, &w->previews);
    case VIEW_SAID_BARS: return flag(j, &w->bars);
    case VIEW_SAID_SOOT: return flag(j, &w->soot);
    case VIEW_SAID_PLAY: return flag(j, &w->play);
    case VIEW_SAID_SEEK: return words_whole(j, &w->seek);
    case VIEW_SAID_SPEED: return words_speed(j, &w->speed);
    case VIEW_SAID_ORDER: return words_order(j, &w->order);
    default: return true;
    }
}

bool view_words_read(const char *text, size_t len, struct view_words *out)
{
    *out = (struct view_words){0};
    if (len > VIEW_WORDS_MAX)
        return false;
    cJSON *j = cJSON_ParseWithLength(text, len);
    bool good = cJSON_IsObject(j) != 0;
    for (const cJSON *i = good ? j->child : NULL; i != NULL && good; i = i->next)
        good = words_take(i, out);
    cJSON_Delete(j);
    return good;
}
