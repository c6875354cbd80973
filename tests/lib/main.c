/* main.c - main() of the tests that have nothing to set up. */
int t_run(void); /* t.h */

__attribute__((weak)) int main(void)
{
    return t_run();
}
