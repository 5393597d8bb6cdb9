/* A USB driver of libgphoto2 (an "iolib") whose bus is a Unix-domain socket: every call is asked of the simulator, package
 * simulated-eos, src/usb. Built with `cc -shared -fPIC`, loaded through the environment variable IOLIBS, which names its directory.
 *
 * A call that the simulator never answers never returns. Nothing is decided here.
 *
 * libgphoto2-dev has no gphoto2-port-library.h: the table of operations is that of libgphoto2 2.5.30,
 * libgphoto2_port/gphoto2/gphoto2-port-library.h.
 */
#define _DEFAULT_SOURCE
#include <gphoto2/gphoto2-port-result.h>
#include <gphoto2/gphoto2-port.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

/* The environment variable that names the socket. */
#define SOCKET_PATH "SIMULATED_USB"
/* Canon EOS 5D Mark II (libgphoto2, camlibs/ptp2/library.c). */
#define CANON 0x04a9
#define EOS_5D_MARK_II 0x3199

struct _GPPortPrivateLibrary {
	int fd; /* -1 without a simulator */
};

typedef struct {
	int (*init)(GPPort *);
	int (*exit)(GPPort *);
	int (*open)(GPPort *);
	int (*close)(GPPort *);
	int (*read)(GPPort *, char *, int);
	int (*check_int)(GPPort *, char *, int, int);
	int (*write)(GPPort *, const char *, int);
	int (*update)(GPPort *);
	void *get_pin, *set_pin, *send_break, *flush;
	int (*find_device)(GPPort *, int, int);
	int (*find_device_by_class)(GPPort *, int, int, int);
	int (*clear_halt)(GPPort *, int);
	/* Control transfers, which an EOS needs only after errors, seeks, SCSI and resets: not supported. */
	void *msg_write, *msg_read, *msg_interface_write, *msg_interface_read, *msg_class_write, *msg_class_read;
	void *seek, *send_scsi_cmd, *reset;
} Operations;

/* As src/usb/wire.rs has them. */
enum call { LIST = 1, FIND, OPEN, CLOSE, WRITE, READ, INTERRUPT, CLEAR_HALT };

static int simulator(void)
{
	const char *path = getenv(SOCKET_PATH);
	struct sockaddr_un address = {.sun_family = AF_UNIX};
	int fd;

	if (!path || strlen(path) >= sizeof(address.sun_path))
		return -1;
	strcpy(address.sun_path, path);
	fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
	if (fd >= 0 && connect(fd, (struct sockaddr *)&address, sizeof(address)) < 0) {
		close(fd);
		fd = -1;
	}
	return fd;
}

static int sent(int fd, const void *from, size_t size)
{
	return size == 0 || send(fd, from, size, MSG_NOSIGNAL) == (ssize_t)size;
}

static int received(int fd, void *to, size_t size)
{
	return size == 0 || recv(fd, to, size, MSG_WAITALL) == (ssize_t)size;
}

/* Asks the simulator. `out` goes with the question, at most `wanted` bytes of answer come into `in`. Returns what libgphoto2 is told. */
static int ask(int fd, enum call call, int timeout_ms, const void *out, int size, void *in, int wanted)
{
	int32_t question[4] = {call, timeout_ms, wanted, size};
	int32_t answer[2]; /* result, bytes that follow */

	if (fd < 0 || !sent(fd, question, sizeof(question)) || !sent(fd, out, size))
		return GP_ERROR_IO;
	if (!received(fd, answer, sizeof(answer)) || answer[1] < 0 || answer[1] > wanted || !received(fd, in, answer[1]))
		return GP_ERROR_IO;
	return answer[0];
}

static int ask_of(GPPort *port, enum call call)
{
	const char *path = port->settings.usb.port;

	return ask(port->pl->fd, call, port->timeout, path, strnlen(path, sizeof(port->settings.usb.port)), NULL, 0);
}

static int usb_init(GPPort *port)
{
	port->pl = malloc(sizeof(*port->pl));
	if (!port->pl)
		return GP_ERROR_NO_MEMORY;
	port->pl->fd = simulator();
	return GP_OK;
}

static int usb_exit(GPPort *port)
{
	if (port->pl && port->pl->fd >= 0)
		close(port->pl->fd);
	free(port->pl);
	port->pl = NULL;
	return GP_OK;
}

static int usb_open(GPPort *port)
{
	return ask_of(port, OPEN);
}

static int usb_close(GPPort *port)
{
	return ask_of(port, CLOSE);
}

static int usb_read(GPPort *port, char *bytes, int size)
{
	return ask(port->pl->fd, READ, port->timeout, NULL, 0, bytes, size);
}

static int usb_write(GPPort *port, const char *bytes, int size)
{
	return ask(port->pl->fd, WRITE, port->timeout, bytes, size, NULL, 0);
}

static int usb_check_int(GPPort *port, char *bytes, int size, int timeout_ms)
{
	return ask(port->pl->fd, INTERRUPT, timeout_ms, NULL, 0, bytes, size);
}

static int usb_clear_halt(GPPort *port, int endpoint)
{
	return ask(port->pl->fd, CLEAR_HALT, endpoint, NULL, 0, NULL, 0);
}

static int usb_update(GPPort *port)
{
	port->settings.usb = port->settings_pending.usb;
	return GP_OK;
}

static int usb_find_device(GPPort *port, int vendor, int product)
{
	int result;

	if (vendor != CANON || product != EOS_5D_MARK_II)
		return GP_ERROR_IO_USB_FIND;
	result = ask_of(port, FIND);
	if (result == GP_OK) {
		port->settings.usb.config = 1;
		port->settings.usb.interface = 0;
		port->settings.usb.altsetting = 0;
		port->settings.usb.inep = 0x81;
		port->settings.usb.outep = 0x02;
		port->settings.usb.intep = 0x83;
		port->settings.usb.maxpacketsize = 512;
	}
	return result;
}

static int usb_find_device_by_class(GPPort *port, int class, int subclass, int protocol)
{
	(void)port, (void)class, (void)subclass, (void)protocol;
	return GP_ERROR_IO_USB_FIND;
}

GPPortType gp_port_library_type(void)
{
	return GP_PORT_USB;
}

static int append(GPPortInfoList *list, const char *name, const char *path)
{
	GPPortInfo info;
	int result = gp_port_info_new(&info);

	if (result < GP_OK)
		return result;
	gp_port_info_set_type(info, GP_PORT_USB);
	gp_port_info_set_name(info, name);
	gp_port_info_set_path(info, path);
	/* The generic entry's return value is -1 without being an error. */
	gp_port_info_list_append(list, info);
	return GP_OK;
}

/* As the real one: a pattern for any port, then those with a device. */
int gp_port_library_list(GPPortInfoList *list)
{
	char paths[1024], *rest = paths, *path;
	int fd = simulator(), size = ask(fd, LIST, 0, NULL, 0, paths, sizeof(paths) - 1), result;

	if (fd >= 0)
		close(fd);
	if (size < 0)
		return size;
	paths[size] = 0;
	result = append(list, "", "^usb:");
	while (result == GP_OK && (path = strsep(&rest, "\n")) && *path)
		result = append(list, "Universal Serial Bus", path);
	return result;
}

/* libgphoto2 frees it. */
Operations *gp_port_library_operations(void)
{
	Operations *operations = calloc(1, sizeof(*operations));

	if (operations)
		*operations = (Operations){
			.init = usb_init,
			.exit = usb_exit,
			.open = usb_open,
			.close = usb_close,
			.read = usb_read,
			.check_int = usb_check_int,
			.write = usb_write,
			.update = usb_update,
			.find_device = usb_find_device,
			.find_device_by_class = usb_find_device_by_class,
			.clear_halt = usb_clear_halt,
		};
	return operations;
}
