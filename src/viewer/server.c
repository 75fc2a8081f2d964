/* SPDX-License-Identifier: MIT
 * server.c - serves the page's files over HTTP, and its messages over a WebSocket, by libwebsockets on the main thread. */
#include "viewer/address.h"
#include "viewer/viewer.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <libwebsockets.h>
#include <limits.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/inotify.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#define ALONE_SECONDS 600.0 /* after the last page has been closed */
#define FIRST_SECONDS 3600  /* for the first page: its user may have to log in from another machine */
#define SETTLE_US 150000    /* a program that writes a file may write others right after */
#define TICK_US 250000      /* longest delay until Ctrl-C is noticed */
#define WATCHED_MOST 256    /* folders */
#define WATCHED_DEPTH 4     /* of folders below that of the input */
#define GUESTS_MOST 64      /* connections that are no page: a browser opens six for the files of one */
#define REQUEST_SECONDS 10  /* for a request to arrive */
#define IDLE_SECONDS 5      /* until the next request of a connection */
#define GUEST_SECONDS 20.0  /* without a request */

static const char security[] = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; "
                               "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

#define PAGE_PROTOCOL "pellucid"

_Static_assert(VIEWER_ROOM >= LWS_PRE, "libwebsockets writes its head before a message");

/* A connection that is no page. */
struct guest {
    struct lws *wsi;
    double seen; /* time of its last request, or of the last part of a file that it took */
};

struct server {
    struct viewer *v;
    const struct viewer_server_params *params;
    int port;
    struct lws_context *lws;
    lws_sorted_usec_list_t tick, settle;
    struct guest guests[GUESTS_MOST]; /* the oldest first */
    int num_guests, most_guests;
    int pages;
    bool visited;
    double empty_since; /* time since which no page has been open */
};

/* One page's connection. */
struct connection {
    uint64_t number; /* 0: refused */
    unsigned char *text;
    size_t length;
};

/* One file being sent. */
struct request {
    const struct viewer_file *file;
    size_t sent;
};

static struct server *server_of(struct lws *wsi)
{
    return lws_context_user(lws_get_context(wsi));
}

/* --- Access ------------------------------------------------------------------------------------------------------------------------- */

static const char *header(struct lws *wsi, enum lws_token_indexes which, char *text, int size)
{
    if (lws_hdr_copy(wsi, text, size, which) < 0)
        text[0] = '\0';
    return text;
}

static bool from_here(struct lws *wsi)
{
    char host[160], origin[200];

    header(wsi, WSI_TOKEN_HOST, host, sizeof(host));
    header(wsi, WSI_TOKEN_ORIGIN, origin, sizeof(origin));
    return viewer_host_allowed(host, server_of(wsi)->params->address) && viewer_origin_allowed(origin, host);
}

static bool has_token(struct lws *wsi)
{
    char given[2 * VIEWER_TOKEN];
    const char *value = lws_get_urlarg_by_name(wsi, "token=", given, sizeof(given));

    return viewer_token_equal(server_of(wsi)->params->token, value ? value : "");
}

static int refuse(struct lws *wsi, unsigned status, const char *why)
{
    lws_return_http_status(wsi, status, why);
    return -1;
}

/* Called for every request to become another protocol, whatever its name, before the one that it names is asked. */
static int allow_upgrade(struct lws *wsi, const char *to)
{
    char wanted[40];

    header(wsi, WSI_TOKEN_PROTOCOL, wanted, sizeof(wanted));
    if (strcasecmp(to, "websocket") != 0 || strcmp(wanted, PAGE_PROTOCOL) != 0)
        return refuse(wsi, HTTP_STATUS_BAD_REQUEST, "there is no such protocol");
    if (!from_here(wsi) || !has_token(wsi))
        return refuse(wsi, HTTP_STATUS_FORBIDDEN, "only a page of this program may connect");
    return 0;
}

/* --- Guests: connections that are no page --------------------------------------------------------------------------------------------- */

static void forget_guest(struct server *s, const struct lws *wsi)
{
    int left = 0;

    for (int i = 0; i < s->num_guests; i++)
        if (s->guests[i].wsi != wsi)
            s->guests[left++] = s->guests[i];
    s->num_guests = left;
}

static void dismiss_guest(struct server *s, struct lws *wsi)
{
    lws_set_timeout(wsi, PENDING_TIMEOUT_USER_OK, LWS_TO_KILL_SYNC); /* lws_wsi_close() of 4.1 closes another connection */
    forget_guest(s, wsi);
}

/* Where there are too many, the oldest goes: others can't keep out the browser of a page, whose requests are answered at once. */
static void remember_guest(struct server *s, struct lws *wsi)
{
    while (s->num_guests >= s->most_guests)
        dismiss_guest(s, s->guests[0].wsi);
    s->guests[s->num_guests++] = (struct guest) { wsi, pell_seconds() };
}

static void guest_seen(struct server *s, const struct lws *wsi)
{
    for (int i = 0; i < s->num_guests; i++)
        if (s->guests[i].wsi == wsi)
            s->guests[i].seen = pell_seconds();
}

/* libwebsockets has timeouts for most connections, but not for all. */
static void dismiss_silent_guests(struct server *s)
{
    const double now = pell_seconds();

    for (int i = s->num_guests; i-- > 0;)
        if (now - s->guests[i].seen > GUEST_SECONDS)
            dismiss_guest(s, s->guests[i].wsi);
}

static int guests_most(void)
{
    struct rlimit files;

    return getrlimit(RLIMIT_NOFILE, &files) == 0 && files.rlim_cur < 4 * GUESTS_MOST ? 1 + (int) files.rlim_cur / 4 : GUESTS_MOST;
}

/* --- Files ---------------------------------------------------------------------------------------------------------------------------- */

static bool has_body(struct lws *wsi)
{
    char length[32];

    header(wsi, WSI_TOKEN_HTTP_CONTENT_LENGTH, length, sizeof(length));
    return strspn(length, "0") != strlen(length) || lws_hdr_total_length(wsi, WSI_TOKEN_HTTP_TRANSFER_ENCODING) > 0;
}

/* A request that sends or changes something: its body is not waited for. */
static int refuse_method(struct lws *wsi)
{
    static const char allow[] = "GET, HEAD", why[] = "only GET and HEAD are served\n";
    unsigned char head[LWS_PRE + 512], *start = head + LWS_PRE, *p = start, *end = head + sizeof(head) - 1;

    if (lws_add_http_common_headers(wsi, HTTP_STATUS_METHOD_NOT_ALLOWED, "text/plain", sizeof(why) - 1, &p, end) ||
        lws_add_http_header_by_name(wsi, (const unsigned char *) "allow:", (const unsigned char *) allow, sizeof(allow) - 1, &p, end) ||
        lws_add_http_header_by_token(wsi, WSI_TOKEN_CONNECTION, (const unsigned char *) "close", 5, &p, end) ||
        lws_finalize_write_http_header(wsi, start, &p, end))
        return -1;
    memcpy(start, why, sizeof(why));
    lws_write(wsi, start, sizeof(why) - 1, LWS_WRITE_HTTP_FINAL);
    return -1;
}

static int begin_file(struct lws *wsi, struct request *r, const char *path)
{
    static const struct {
        const char *name, *value;
    } headers[] = {
        { "content-security-policy:", security },
        { "x-content-type-options:", "nosniff" },
        { "referrer-policy:", "no-referrer" },
        { "cache-control:", "no-store" },
        { "cross-origin-opener-policy:", "same-origin" },
        { "cross-origin-resource-policy:", "same-origin" },
    };
    unsigned char head[LWS_PRE + 2048], *start = head + LWS_PRE, *p = start, *end = head + sizeof(head) - 1;

    guest_seen(server_of(wsi), wsi);
    if (!from_here(wsi))
        return refuse(wsi, HTTP_STATUS_FORBIDDEN, "this host name is not served");
    if (!lws_hdr_total_length(wsi, WSI_TOKEN_GET_URI) && !lws_hdr_total_length(wsi, WSI_TOKEN_HEAD_URI))
        return refuse_method(wsi);
    if (has_body(wsi))
        return refuse(wsi, HTTP_STATUS_BAD_REQUEST, "a request for a page has no body");
    r->file = NULL;
    r->sent = 0;
    for (size_t i = 0; i < viewer_num_files; i++)
        if (strcmp(viewer_files[i].path, path) == 0)
            r->file = &viewer_files[i];
    if (!r->file)
        return refuse(wsi, HTTP_STATUS_NOT_FOUND, "there is no such page");
    if (strcmp(path, "/") == 0 && !has_token(wsi))
        return refuse(wsi, HTTP_STATUS_FORBIDDEN, "the address lacks the token: copy all of the line that pellucid view printed");
    if (lws_add_http_common_headers(wsi, HTTP_STATUS_OK, r->file->type, r->file->size, &p, end))
        return -1;
    for (size_t i = 0; i < PELL_COUNT(headers); i++)
        if (lws_add_http_header_by_name(wsi, (const unsigned char *) headers[i].name, (const unsigned char *) headers[i].value,
                                        (int) strlen(headers[i].value), &p, end))
            return -1;
    if (lws_finalize_write_http_header(wsi, start, &p, end))
        return -1;
    if (lws_hdr_total_length(wsi, WSI_TOKEN_HEAD_URI))
        return lws_http_transaction_completed(wsi) ? -1 : 0;
    lws_callback_on_writable(wsi);
    return 0;
}

static int continue_file(struct lws *wsi, struct request *r)
{
    unsigned char part[LWS_PRE + 16384];
    size_t n;

    if (!r->file)
        return -1;
    n = r->file->size - r->sent;
    if (n > sizeof(part) - LWS_PRE)
        n = sizeof(part) - LWS_PRE;
    memcpy(part + LWS_PRE, r->file->bytes + r->sent, n);
    r->sent += n;
    guest_seen(server_of(wsi), wsi);
    if (lws_write(wsi, part + LWS_PRE, n, r->sent == r->file->size ? LWS_WRITE_HTTP_FINAL : LWS_WRITE_HTTP) < (int) n)
        return -1;
    if (r->sent == r->file->size)
        return lws_http_transaction_completed(wsi) ? -1 : 0;
    lws_callback_on_writable(wsi);
    return 0;
}

static int on_http(struct lws *wsi, enum lws_callback_reasons reason, void *user, void *in, size_t size)
{
    switch (reason) {
    case LWS_CALLBACK_SERVER_NEW_CLIENT_INSTANTIATED: remember_guest(server_of(wsi), wsi); return 0;
    case LWS_CALLBACK_WSI_DESTROY: forget_guest(server_of(wsi), wsi); return 0;
    case LWS_CALLBACK_HTTP_CONFIRM_UPGRADE: return allow_upgrade(wsi, in);
    case LWS_CALLBACK_FILTER_PROTOCOL_CONNECTION: return -1;
    case LWS_CALLBACK_HTTP: return begin_file(wsi, user, in);
    case LWS_CALLBACK_HTTP_WRITEABLE: return continue_file(wsi, user);
    default: return lws_callback_http_dummy(wsi, reason, user, in, size);
    }
}

/* --- Pages ---------------------------------------------------------------------------------------------------------------------------- */

static int close_for(struct lws *wsi, enum lws_close_status status, const char *why)
{
    lws_close_reason(wsi, status, (unsigned char *) (uintptr_t) why, strlen(why));
    return -1;
}

static int open_page(struct lws *wsi, struct connection *c)
{
    struct server *s = server_of(wsi);
    struct viewer_page *page = viewer_page_open(s->v);

    *c = (struct connection) { .number = page ? page->number : 0 };
    if (!page)
        return close_for(wsi, LWS_CLOSE_STATUS_POLICY_VIOLATION, "too many pages are open: close one, and this one connects");
    forget_guest(s, wsi);
    s->pages++;
    s->visited = true;
    viewer_greet(s->v, c->number);
    lws_callback_on_writable(wsi);
    return 0;
}

static void close_page(struct lws *wsi, struct connection *c)
{
    struct server *s = server_of(wsi);

    if (c->number) {
        viewer_page_close(s->v, c->number);
        s->pages--;
        s->empty_since = pell_seconds();
    }
    free(c->text);
    *c = (struct connection) { .number = 0 };
}

/* Collects the parts of a message. */
static int receive(struct lws *wsi, struct connection *c, const void *in, size_t size)
{
    struct server *s = server_of(wsi);
    struct viewer_message *message;

    if (lws_frame_is_binary(wsi))
        return close_for(wsi, LWS_CLOSE_STATUS_UNACCEPTABLE_OPCODE, "messages are JSON");
    if (size > VIEWER_MESSAGE_BYTES - c->length)
        return close_for(wsi, LWS_CLOSE_STATUS_MESSAGE_TOO_LARGE, "the message is too long");
    if (!c->text && !(c->text = malloc(VIEWER_MESSAGE_BYTES)))
        return -1;
    memcpy(c->text + c->length, in, size);
    c->length += size;
    if (!lws_is_final_fragment(wsi) || lws_remaining_packet_payload(wsi))
        return 0;
    size = c->length;
    c->length = 0;
    if (viewer_message_parse(s->v->parsing, c->text, size, &message) != PELL_OK)
        return close_for(wsi, LWS_CLOSE_STATUS_PROTOCOL_ERR, "the message can't be read");
    if (!viewer_accept(s->v, c->number, message))
        return close_for(wsi, LWS_CLOSE_STATUS_POLICY_VIOLATION, "the message acknowledges what was not sent");
    lws_callback_on_writable(wsi);
    return 0;
}

static int write_next(struct lws *wsi, struct connection *c)
{
    struct viewer_outgoing *n = viewer_next(server_of(wsi)->v, c->number);
    int written;

    if (!n)
        return 0;
    written = lws_write(wsi, n->bytes, n->size, n->binary ? LWS_WRITE_BINARY : LWS_WRITE_TEXT);
    viewer_outgoing_free(n);
    if (written < 0)
        return -1;
    lws_callback_on_writable(wsi);
    return 0;
}

static int on_page(struct lws *wsi, enum lws_callback_reasons reason, void *user, void *in, size_t size)
{
    switch (reason) {
    case LWS_CALLBACK_FILTER_PROTOCOL_CONNECTION: return from_here(wsi) && has_token(wsi) ? 0 : -1;
    case LWS_CALLBACK_ESTABLISHED: return open_page(wsi, user);
    case LWS_CALLBACK_CLOSED: close_page(wsi, user); return 0;
    case LWS_CALLBACK_RECEIVE: return receive(wsi, user, in, size);
    case LWS_CALLBACK_SERVER_WRITEABLE: return write_next(wsi, user);
    case LWS_CALLBACK_EVENT_WAIT_CANCELLED: lws_callback_on_writable_all_protocol(lws_get_context(wsi), lws_get_protocol(wsi)); return 0;
    default: return 0;
    }
}

/* --- Files that change ---------------------------------------------------------------------------------------------------------------- */

static void on_settled(lws_sorted_usec_list_t *list)
{
    struct server *s = lws_container_of(list, struct server, settle);

    viewer_files_changed(s->v);
}

static bool is_input(const char *name)
{
    static const char *const endings[] = { ".json", ".obj", ".mtl",  ".ply", ".stl", ".gltf", ".glb", ".bin",
                                           ".png",  ".jpg", ".jpeg", ".exr", ".hdr", ".csv",  ".spv" };
    const char *dot = strrchr(name, '.');

    for (size_t i = 0; dot && i < PELL_COUNT(endings); i++)
        if (strcasecmp(dot, endings[i]) == 0)
            return true;
    return false;
}

static int on_files(struct lws *wsi, enum lws_callback_reasons reason, void *user, void *in, size_t size)
{
    struct server *s = server_of(wsi);
    union {
        struct inotify_event event;
        char bytes[16 * (sizeof(struct inotify_event) + NAME_MAX + 1)];
    } buffer;
    bool changed = false;
    ssize_t n;

    (void) user;
    (void) in;
    (void) size;
    if (reason == LWS_CALLBACK_FILTER_PROTOCOL_CONNECTION)
        return -1;
    if (reason != LWS_CALLBACK_RAW_RX_FILE)
        return 0;
    while ((n = read(lws_get_socket_fd(wsi), buffer.bytes, sizeof(buffer.bytes))) > 0)
        for (ssize_t i = 0; i < n;) {
            const struct inotify_event *e = (const struct inotify_event *) (const void *) (buffer.bytes + i);
            changed |= e->len > 0 && is_input(e->name);
            i += (ssize_t) (sizeof(*e) + e->len);
        }
    if (changed)
        lws_sul_schedule(s->lws, 0, &s->settle, on_settled, SETTLE_US);
    return 0;
}

/* Watches a folder and its subfolders, except hidden ones; `*left`: how many more may be watched. */
static void watch_folder(int fd, const char *path, int deeper, int *left)
{
    DIR *folder;
    const struct dirent *entry;

    if (*left <= 0 || inotify_add_watch(fd, path, IN_CLOSE_WRITE | IN_MOVED_TO | IN_ONLYDIR) < 0)
        return;
    --*left;
    folder = deeper > 0 ? opendir(path) : NULL;
    while (folder && (entry = readdir(folder)) != NULL) {
        char below[PATH_MAX];
        const int n = snprintf(below, sizeof(below), "%s/%s", path, entry->d_name);
        struct stat about;
        if (entry->d_name[0] != '.' && n > 0 && (size_t) n < sizeof(below) && lstat(below, &about) == 0 && S_ISDIR(about.st_mode))
            watch_folder(fd, below, deeper - 1, left);
    }
    if (folder)
        closedir(folder);
}

static void watch(struct server *s)
{
    const int fd = inotify_init1(IN_NONBLOCK | IN_CLOEXEC);
    lws_sock_file_fd_type file;
    int left = WATCHED_MOST;

    if (fd < 0)
        return;
    file.filefd = fd;
    watch_folder(fd, s->params->folder, WATCHED_DEPTH, &left);
    if (s->params->shaders)
        watch_folder(fd, s->params->shaders, 0, &left);
    if (left == WATCHED_MOST ||
        !lws_adopt_descriptor_vhost(lws_get_vhost_by_name(s->lws, "default"), LWS_ADOPT_RAW_FILE_DESC, file, "files", NULL))
        close(fd);
}

/* --- Serving -------------------------------------------------------------------------------------------------------------------------- */

static const struct lws_protocols protocols[] = {
    { "http", on_http, sizeof(struct request), 0, 0, NULL, 0 },
    { PAGE_PROTOCOL, on_page, sizeof(struct connection), 16384, 0, NULL, 0 },
    { "files", on_files, 0, 0, 0, NULL, 0 },
    { NULL, NULL, 0, 0, 0, NULL, 0 },
};

/* Called from any thread. */
static void notify(struct viewer *v)
{
    lws_cancel_service(v->server);
}

static void on_tick(lws_sorted_usec_list_t *list)
{
    struct server *s = lws_container_of(list, struct server, tick);

    dismiss_silent_guests(s);
    lws_sul_schedule(s->lws, 0, &s->tick, on_tick, TICK_US);
}

static void silence(int level, const char *line)
{
    (void) level;
    (void) line;
}

/* Starts a program that opens an address, if there is one, without waiting for it. */
static void open_browser(const char *address)
{
    const char *named = getenv("BROWSER"), *display = getenv("DISPLAY"), *wayland = getenv("WAYLAND_DISPLAY");
    const char *program = named && named[0] && !strpbrk(named, ":% ") ? named : "xdg-open";
    pid_t child;

    if (program != named && !(display && display[0]) && !(wayland && wayland[0]))
        return;
    child = fork();
    if (child == 0) {
        if (fork() == 0) {
            const int null = open("/dev/null", O_RDWR);
            if (null >= 0) {
                dup2(null, STDIN_FILENO);
                dup2(null, STDOUT_FILENO);
                dup2(null, STDERR_FILENO);
            }
            execlp(program, program, address, (char *) NULL);
        }
        _exit(0);
    }
    if (child > 0)
        waitpid(child, NULL, 0);
}

static enum exit_code print_address(struct server *s)
{
    struct cli *cli = s->v->cli;
    const bool all = strcmp(s->params->address, "0.0.0.0") == 0;
    char address[256];

    snprintf(address, sizeof(address), "http://%s:%d/?token=%s", all ? "127.0.0.1" : s->params->address, s->port, s->params->token);
    if (!viewer_is_loopback(s->params->address))
        pell_warn(cli->ctx, "--listen", NULL,
                  "anyone who can reach %s and knows the token can see the scene and use this machine's processor; nothing is encrypted",
                  s->params->address);
    if (cli->json) {
        const enum exit_code code =
            cli_print_json(cli, json_pack("{s:s,s:i,s:s}", "address", address, "port", s->port, "token", s->params->token));
        fflush(stdout);
        return code;
    }
    printf("%s\n", address);
    fflush(stdout);
    if (!cli->quiet)
        fputs("open it in a browser; Ctrl-C ends\n", stderr);
    if (s->params->open)
        open_browser(address);
    return EXIT_OK;
}

enum exit_code viewer_find_port(struct cli *cli, const char *address, int *port)
{
    const int error = viewer_probe(address, port);

    if (error == EINVAL)
        return cli_usage(cli, "--listen", "127.0.0.1, or 0.0.0.0 for every network", "\"%s\" is not an IPv4 address", address);
    if (error != 0)
        return cli_usage(cli, error == EADDRNOTAVAIL ? "--listen" : "--port", "--port 0 takes one that is free", "%s:%d: %s", address,
                         *port,
                         error == EADDRINUSE      ? "another program listens there"
                         : error == EACCES        ? "needs more rights"
                         : error == EADDRNOTAVAIL ? "this machine has no such address"
                                                  : "can't listen on this address");
    return EXIT_OK;
}

static enum exit_code listen_at(struct server *s)
{
    const struct viewer_server_params *p = s->params;
    struct lws_context_creation_info info = { 0 };
    enum exit_code code;

    s->port = p->port;
    if ((code = viewer_find_port(s->v->cli, p->address, &s->port)) != EXIT_OK)
        return code;
    lws_set_log_level(0, silence);
    info.port = s->port;
    info.iface = strcmp(p->address, "0.0.0.0") == 0 ? NULL : p->address;
    info.protocols = protocols;
    info.vhost_name = "default";
    info.gid = (gid_t) -1;
    info.uid = (uid_t) -1;
    info.user = s;
    info.options = LWS_SERVER_OPTION_DISABLE_IPV6;
    info.server_string = "pellucid";
    info.timeout_secs = REQUEST_SECONDS;
    info.keepalive_timeout = IDLE_SECONDS;
    s->most_guests = guests_most();
    s->lws = lws_create_context(&info);
    if (!s->lws)
        return cli_failed(s->v->cli, pell_error(s->v->cli->ctx, PELL_ERR_IO, "viewer", NULL, "%s:%d can't be served", p->address, s->port));
    return EXIT_OK;
}

/* Nobody looks at it any more. */
static bool has_been_left(const struct server *s)
{
    const double most = s->params->end_after > 0.0 ? s->params->end_after : s->visited ? ALONE_SECONDS : FIRST_SECONDS;

    if (s->pages > 0 || pell_seconds() - s->empty_since <= most)
        return false;
    pell_info(s->v->cli->ctx, "viewer", "ends: no page has been open for %.0f s; --end-after sets another time", most);
    return true;
}

enum exit_code viewer_serve(struct viewer *v, const struct viewer_server_params *params)
{
    struct server s = { .v = v, .params = params };
    enum exit_code code;

    if ((code = listen_at(&s)) != EXIT_OK)
        return code;
    pthread_mutex_lock(&v->lock);
    v->server = s.lws;
    v->notify = notify;
    pthread_mutex_unlock(&v->lock);
    watch(&s);
    on_tick(&s.tick);
    code = print_address(&s);
    s.empty_since = pell_seconds();
    while (code == EXIT_OK && !pell_cancelled(v->cli->ctx) && lws_service(s.lws, 0) >= 0)
        if (has_been_left(&s))
            break;
    pthread_mutex_lock(&v->lock);
    v->notify = NULL;
    pthread_mutex_unlock(&v->lock);
    lws_context_destroy(s.lws);
    return code;
}
