//! The Zenoh session of a participant (clauses P2 and P3).

use std::fs::{self, OpenOptions};
use std::io::Write;
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{channel, Receiver, RecvTimeoutError, Sender};
use std::time::Duration;

use serde_json::{json, Value as Json};
use zenoh::handlers::FifoChannelHandler;
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::{Publisher, Subscriber};
use zenoh::qos::CongestionControl;
use zenoh::query::{ConsolidationMode, QueryTarget, Reply};
use zenoh::sample::SampleKind;
use zenoh::{Config, Session, Wait};

use crate::ticket::{Endpoint, Ticket};

/// An event from Zenoh's threads.
pub enum Event {
    /// A payload of the source with this index.
    Output(usize, Vec<u8>),
    /// A payload of `start`.
    Start(Vec<u8>),
    /// A payload of `trigger`.
    Trigger(Vec<u8>),
    /// A payload of `stop`.
    Stop(Vec<u8>),
    /// The orchestrator has disappeared.
    Gone,
}

/// An open session, with the publishers and subscribers of a participant.
pub struct Bus {
    session: Session,
    keys: String,
    name: String,
    out: Publisher<'static>,
    log: Publisher<'static>,
    subscribers: Vec<Subscriber<()>>,
    _alive: LivelinessToken,
    sender: Sender<Event>,
    events: Receiver<Event>,
}

impl Bus {
    /// Opens the session, declares that the participant is alive (P4.1), and watches the
    /// orchestrator (P4.4).
    pub fn open(ticket: &Ticket) -> zenoh::Result<Self> {
        let dictionary = write_dictionary(ticket)?;
        let config = config(&ticket.endpoint, dictionary.as_deref());
        let opened = config.and_then(|config| zenoh::open(config).wait());
        if let Some(path) = dictionary {
            fs::remove_file(path)?;
        }
        let session = opened?;
        let keys = format!("stepbus/{}", ticket.run);
        let name = ticket.name.clone();
        let alive = session.liveliness().declare_token(format!("{keys}/alive/{name}")).wait()?;
        let out = publisher(&session, format!("{keys}/out/{name}"), "Outputs/1")?;
        let log = publisher(&session, format!("{keys}/log/{name}"), "Log/1")?;
        let (sender, events) = channel();
        let gone = sender.clone();
        // Before it asks to join: else it would not hear of an orchestrator that dies meanwhile.
        let orchestrator = format!("{keys}/alive/orchestrator");
        let watch = session.liveliness().declare_subscriber(orchestrator).history(true);
        let watch = watch.callback(move |sample| {
            if sample.kind() == SampleKind::Delete {
                let _ = gone.send(Event::Gone);
            }
        });
        let watch = watch.wait()?;
        Ok(Self {
            session,
            keys,
            name,
            out,
            log,
            subscribers: vec![watch],
            _alive: alive,
            sender,
            events,
        })
    }

    /// Subscribes to the sources, by index, and to the orchestrator (P4.4).
    pub fn subscribe<'a>(&mut self, sources: impl Iterator<Item = &'a str>) -> zenoh::Result<()> {
        for (index, source) in sources.enumerate() {
            self.on(&format!("out/{source}"), move |bytes| Event::Output(index, bytes))?;
        }
        self.on("start", Event::Start)?;
        self.on("trigger", Event::Trigger)?;
        self.on("stop", Event::Stop)
    }

    fn on<F>(&mut self, key: &str, event: F) -> zenoh::Result<()>
    where
        F: Fn(Vec<u8>) -> Event + Send + Sync + 'static,
    {
        let sender = self.sender.clone();
        let subscriber = self.session.declare_subscriber(format!("{}/{key}", self.keys));
        let subscriber = subscriber.callback(move |sample| {
            // The receiver lives as long as the session: a send fails only while both close.
            let _ = sender.send(event(sample.payload().to_bytes().into_owned()));
        });
        self.subscribers.push(subscriber.wait()?);
        Ok(())
    }

    /// Waits for the next event; none after the time.
    pub fn next(&self, timeout: Duration) -> Option<Event> {
        match self.events.recv_timeout(timeout) {
            Ok(event) => Some(event),
            Err(RecvTimeoutError::Timeout) => None,
            Err(RecvTimeoutError::Disconnected) => unreachable!("the bus holds a sender"),
        }
    }

    /// Asks all that answer to be let in, once; yields the payloads of the replies as they arrive
    /// (P4.2).
    pub fn query_join(
        &self,
        hello: Vec<u8>,
        timeout: Duration,
    ) -> zenoh::Result<impl Iterator<Item = Vec<u8>>> {
        let query = self.session.get(format!("{}/join", self.keys)).payload(hello);
        let query = query.encoding(encoding("Hello/1")).timeout(timeout);
        let query = query.target(QueryTarget::All).consolidation(ConsolidationMode::None);
        let replies: FifoChannelHandler<Reply> = query.wait()?;
        let payload = |reply: Reply| Some(reply.result().ok()?.payload().to_bytes().into_owned());
        Ok(replies.into_iter().filter_map(payload))
    }

    /// Publishes an `Outputs`.
    pub fn publish_out(&self, bytes: Vec<u8>) -> zenoh::Result<()> {
        self.out.put(bytes).wait()
    }

    /// Publishes a `Log`.
    pub fn publish_log(&self, bytes: Vec<u8>) -> zenoh::Result<()> {
        self.log.put(bytes).wait()
    }

    /// Publishes one of the rare messages, `ready` or `fault`.
    pub fn publish(&self, key: &str, type_name: &str, bytes: Vec<u8>) -> zenoh::Result<()> {
        let put = self.session.put(format!("{}/{key}/{}", self.keys, self.name), bytes);
        let put = put.encoding(encoding(type_name)).express(true);
        put.congestion_control(CongestionControl::Block).wait()
    }

    /// Closes the session; needed on every path out of the program (P2.6).
    pub fn close(self) -> zenoh::Result<()> {
        self.session.close().wait()
    }
}

fn publisher(session: &Session, key: String, name: &str) -> zenoh::Result<Publisher<'static>> {
    let publisher = session.declare_publisher(key).encoding(encoding(name));
    publisher.congestion_control(CongestionControl::Block).express(true).wait()
}

fn encoding(type_name: &str) -> String {
    format!("application/msgpack;stepbus.{type_name}")
}

fn config(endpoint: &Endpoint, dictionary: Option<&Path>) -> zenoh::Result<Config> {
    let retry = json!({"period_init_ms": 20, "period_max_ms": 200, "period_increase_factor": 2});
    let mut settings: Vec<(&str, Json)> = vec![
        ("mode", json!("peer")),
        ("listen/endpoints", json!(endpoint.listen)),
        ("connect/endpoints", json!(endpoint.connect)),
        ("connect/timeout_ms", json!(-1)),
        ("connect/exit_on_failure", json!(false)),
        ("connect/retry", retry),
        ("scouting/multicast/enabled", json!(false)),
        ("scouting/gossip/enabled", json!(false)),
        ("transport/shared_memory/enabled", json!(false)),
        ("transport/link/tx/lease", json!(3_600_000)),
        ("transport/unicast/accept_timeout", json!(1000)),
    ];
    if endpoint.low_latency {
        settings.push(("transport/unicast/qos/enabled", json!(false)));
        settings.push(("transport/unicast/lowlatency", json!(true)));
    }
    if let Some(path) = dictionary {
        settings.push(("transport/auth/usrpwd/user", json!(endpoint.user)));
        settings.push(("transport/auth/usrpwd/password", json!(endpoint.password)));
        settings.push(("transport/auth/usrpwd/dictionary_file", json!(path)));
    }
    let mut config = Config::default();
    let further = endpoint.settings.iter().map(|(path, value)| (path.as_str(), value.clone()));
    for (path, value) in settings.into_iter().chain(further) {
        config.insert_json5(path, &value.to_string())?;
    }
    Ok(config)
}

/// Writes the users to let in to a private file, if the run has any (P2.4).
fn write_dictionary(ticket: &Ticket) -> std::io::Result<Option<PathBuf>> {
    if ticket.endpoint.user.is_none() {
        return Ok(None);
    }
    let file = format!("stepbus-{}-{}-{}.users", ticket.run, ticket.name, std::process::id());
    let path = std::env::temp_dir().join(file);
    let mut options = OpenOptions::new();
    let mut file = options.write(true).create_new(true).mode(0o600).open(&path)?;
    for (user, password) in &ticket.endpoint.users {
        writeln!(file, "{user}:{password}")?;
    }
    Ok(Some(path))
}
