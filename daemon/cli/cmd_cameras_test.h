/* cmd_cameras_test.h - `pyrovox cameras test`; as cli_command.run. */
#ifndef CMD_CAMERAS_TEST_H
#define CMD_CAMERAS_TEST_H
int cmd_cameras_test(int argc, char **argv);
#endif
