// Prints the length of each classic frame on standard input as can-utils counts it, exactly. See ../lengths.rs.
#include <stdio.h>
#include "canframelen.c"

int main(void)
{
	char line[128];
	while (fgets(line, sizeof(line), stdin)) {
		unsigned id, extended, remote, length, byte;
		char data[32] = "";
		if (sscanf(line, "%x %u %u %*u %*u %*u %u x%31s", &id, &extended, &remote, &length, data) < 4)
			return 1;
		struct canfd_frame frame = { .can_id = id, .len = length };
		if (extended)
			frame.can_id |= CAN_EFF_FLAG;
		if (remote)
			frame.can_id |= CAN_RTR_FLAG;
		for (unsigned i = 0; data[2 * i]; i++) {
			if (sscanf(&data[2 * i], "%2x", &byte) != 1)
				return 1;
			frame.data[i] = byte;
		}
		printf("%u\n", can_frame_length(&frame, CFL_EXACT, CAN_MTU));
	}
	return 0;
}
