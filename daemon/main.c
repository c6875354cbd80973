/* main.c - pyrovoxd: arguments and start/stop order only. */
#include <stdio.h>

int main(void)
{
    fprintf(stderr, "pyrovoxd %s\n", PVX_VERSION);
    return 2;
}
