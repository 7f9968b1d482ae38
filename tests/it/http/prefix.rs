//! The server below a path of a reverse proxy that strips it: pages link relatively, and paths in answers begin with it.

use axum::body::Body;
use axum::http::Request;
use serde_json::json;
use vantage::wire::example;

use super::api::{Answer, Api, cube, http_options, service_options};

const PREFIX: &str = "/plant/vantage";

/// A proxy that serves the API below [`PREFIX`]; it may tell so.
struct Proxy {
    api: Api,
    tells: bool,
}

impl Proxy {
    async fn send(&self, method: &str, path: &str, body: String) -> Answer {
        let stripped = path.strip_prefix(PREFIX).unwrap_or_else(|| panic!("{path} leads past the proxy"));
        let mut request = Request::builder().method(method).uri(stripped).header("content-type", "application/json");
        if self.tells {
            request = request.header("x-forwarded-prefix", PREFIX);
        }
        Answer::read(self.api.raw(request.body(Body::from(body)).expect("a request")).await).await
    }

    async fn get(&self, path: &str) -> Answer {
        self.send("GET", path, String::new()).await
    }
}

/// A proxy that says its prefix, and one whose prefix is a setting.
async fn proxies() -> [Proxy; 2] {
    let configured = vantage::http::ServerOptions { public_path: format!("{PREFIX}/"), ..http_options() };
    let told = Proxy { api: Api::start().await, tells: true };
    [told, Proxy { api: Api::start_with(service_options(), configured).await, tells: false }]
}

/// The address that a link of a page leads to.
fn resolved(page: &str, link: &str) -> String {
    let (mut folders, mut rest) = (page.split('/').collect::<Vec<_>>(), link);
    folders.pop();
    while let Some(up) = rest.strip_prefix("../") {
        folders.pop();
        rest = up;
    }
    format!("{}/{rest}", folders.join("/"))
}

#[tokio::test]
async fn paths_in_answers_lead_through_the_proxy() {
    for proxy in proxies().await {
        let uploaded = proxy.send("POST", &format!("{PREFIX}/api/v1/meshes?unit=mm"), cube(10.0)).await;
        let mesh = uploaded.ok(201)["id"].clone();
        assert_eq!(proxy.get(uploaded.header("location")).await.ok(200)["id"], mesh);
        let request = json!({"mesh_id": mesh, "cell": "none", "labels": {"do": "no_plan"}});
        let accepted = proxy.send("POST", &format!("{PREFIX}/api/v1/jobs"), request.to_string()).await;
        let id = accepted.ok(202)["id"].as_str().expect("an id").to_owned();
        let job = proxy.get(&format!("{}?wait=30s", accepted.header("location"))).await.ok(200);
        // Problems of jobs, in the job itself and in lists, and problems of requests.
        let listed = proxy.get(&format!("{PREFIX}/api/v1/jobs")).await.ok(200)["items"][0]["problem"].clone();
        let refused = proxy.get(&format!("{PREFIX}/api/v1/jobs/{id}?wait=soon")).await;
        let refused: serde_json::Value = serde_json::from_slice(&refused.bytes).expect("JSON");
        assert_eq!(refused["instance"], format!("{PREFIX}/api/v1/jobs/{id}"));
        for problem in [&job["problem"], &listed, &refused] {
            let page = proxy.get(problem["type"].as_str().expect("a path")).await;
            let code = problem["code"].as_str().expect("a code");
            assert!(page.status == 200 && page.text().contains(code), "{problem}");
        }
        let nowhere = proxy.get(&format!("{PREFIX}/api/v1/jobs/")).await;
        let nowhere: serde_json::Value = serde_json::from_slice(&nowhere.bytes).expect("JSON");
        assert_eq!(nowhere["detail"], format!("there is nothing at {PREFIX}/api/v1/jobs/; leave out the slash at the end"));
        let document = proxy.get(&format!("{PREFIX}/api/v1/openapi.json")).await.ok(200);
        assert_eq!(document["servers"], json!([{ "url": PREFIX }]));
    }
}

/// Problems of these routes led past the proxy.
#[tokio::test]
async fn problems_of_inspections_and_calibrations_lead_through_the_proxy() {
    for proxy in proxies().await {
        let below = |path: &str| format!("{PREFIX}/api/v1/{path}");
        let job = super::runs::driven(&proxy.api).await;
        let scan = below(&format!("jobs/{job}/scans?name=view_00.ply"));
        proxy.send("POST", &scan, "no cloud at all".to_owned()).await.ok(201);
        let inspection = proxy.send("POST", &below(&format!("jobs/{job}/inspections")), "{}".to_owned()).await;
        // Every observation from one configuration of the arm.
        let mut request = example::calibration();
        let first = request["data"]["observations"][0].clone();
        for observation in request["data"]["observations"].as_array_mut().expect("a list") {
            let id = observation["id"].clone();
            *observation = first.clone();
            observation["id"] = id;
        }
        let calibration = proxy.send("POST", &below("calibrations"), request.to_string()).await;
        for (accepted, list) in [(inspection, "inspections"), (calibration, "calibrations")] {
            accepted.ok(202);
            let ended = proxy.get(&format!("{}?wait=60s", accepted.header("location"))).await.ok(200);
            let listed = proxy.get(&below(list)).await.ok(200)["items"][0].clone();
            for found in [&ended, &listed] {
                assert_eq!(found["state"], "failed", "{found}");
                let page = proxy.get(found["problem"]["type"].as_str().expect("a path")).await;
                assert_eq!(page.status, 200, "{found}");
            }
        }
    }
}

#[tokio::test]
async fn pages_link_nothing_past_the_proxy() {
    let [_, proxy] = proxies().await;
    for page in ["/", "/docs/", "/parameters", "/problems", "/problems/bad_query"] {
        let page = format!("{PREFIX}{page}");
        let headers = Request::get(&page[PREFIX.len()..]).header("accept", "text/html");
        let answer = Answer::read(proxy.api.raw(headers.body(Body::empty()).expect("a request")).await).await;
        let html = answer.text();
        let links: Vec<&str> = ["href=\"", "src=\""]
            .iter()
            .flat_map(|attribute| html.split(attribute).skip(1).filter_map(|rest| rest.split('"').next()))
            .filter(|link| !link.starts_with('#'))
            .collect();
        assert!(!links.is_empty(), "{page}: {html}");
        for link in links {
            assert!(!link.starts_with('/') && !link.contains("://"), "{page} links {link}");
            let target = resolved(&page, link.split('#').next().unwrap_or(link).trim_start_matches("./"));
            assert!(proxy.get(&target).await.status.is_success(), "{page} links {link}, {target}");
        }
    }
    let moved = proxy.get(&format!("{PREFIX}/docs")).await;
    assert_eq!(resolved(&format!("{PREFIX}/docs"), moved.header("location")), format!("{PREFIX}/docs/"));
    // The documentation asks the server that it came from.
    let document = proxy.get(&format!("{PREFIX}/docs/openapi.json")).await.ok(200);
    let server = document["servers"][0]["url"].as_str().expect("an address");
    assert_eq!(resolved(&format!("{PREFIX}/docs/openapi.json"), server), format!("{PREFIX}/"));
    // The scripts ask below the address of their page.
    let mut scripts = Vec::new();
    for file in std::fs::read_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/static/dist")).expect("the folder").flatten() {
        let name = file.file_name().to_string_lossy().into_owned();
        if name.ends_with(".js") {
            scripts.push(proxy.get(&format!("{PREFIX}/assets/{name}")).await.text());
        }
    }
    assert!(scripts.iter().any(|script| script.contains("new URL(\"api/v1\",document.baseURI)")));
    assert!(!scripts.iter().any(|script| script.contains("\"/api") || script.contains("`/api") || script.contains("\"/assets")));
}

#[tokio::test]
async fn a_session_s_cookie_is_for_the_prefix_alone() {
    let key: vantage::http::ApiKey = serde_json::from_value(json!("0123456789abcdef-key")).expect("a key");
    let api = Api::start_with(service_options(), vantage::http::ServerOptions { api_key: Some(key), ..http_options() }).await;
    let headers = [("authorization", "Bearer 0123456789abcdef-key"), ("x-forwarded-prefix", PREFIX)];
    let cookie = api.send("POST", "/api/v1/session", &headers, "").await.header("set-cookie").to_owned();
    assert!(cookie.contains(&format!("; Path={PREFIX}/; HttpOnly; SameSite=Strict")), "{cookie}");
    let ended = api.send("DELETE", "/api/v1/session", &headers, "").await.header("set-cookie").to_owned();
    assert!(ended.contains(&format!("; Path={PREFIX}/;")), "{ended}");
}

#[tokio::test]
async fn only_a_trusted_proxy_is_believed_and_only_a_path() {
    let location = async |api: &Api, prefix: &str| {
        api.send("POST", "/api/v1/meshes?unit=mm", &[("x-forwarded-prefix", prefix)], cube(10.0))
            .await
            .header("location")
            .to_owned()
    };
    let api = Api::start().await;
    for nonsense in ["//evil.example", "https://evil.example", "/a b", "/..", "vantage", "/", "/a\";x=\"", "/?"] {
        assert!(location(&api, nonsense).await.starts_with("/api/v1/meshes/"), "{nonsense}");
    }
    assert!(location(&api, "/a/").await.starts_with("/a/api/v1/meshes/"));
    // Two proxies, of which the outer comes first.
    assert!(location(&api, "/outer, /inner").await.starts_with("/outer/inner/api/v1/meshes/"));
    let strangers = vantage::http::ServerOptions { trusted_proxies: Vec::new(), ..http_options() };
    let api = Api::start_with(service_options(), strangers).await;
    assert!(location(&api, "/a").await.starts_with("/api/v1/meshes/"));
}
